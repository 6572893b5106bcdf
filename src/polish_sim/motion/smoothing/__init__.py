"""A chain of straight segments and its schedule: what is moved along, and when (layer 6)."""
