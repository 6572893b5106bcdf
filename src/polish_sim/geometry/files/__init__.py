"""Mesh files read: STL, PLY, OBJ (bytes -> triangles)."""
