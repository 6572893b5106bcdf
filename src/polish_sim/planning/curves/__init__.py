"""Curves on a surface and their offsets: the turns that cover a region."""
