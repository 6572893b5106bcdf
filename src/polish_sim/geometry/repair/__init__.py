"""Repairs of a mesh, one file each: from a soup of triangles to a skin one can plan on."""
