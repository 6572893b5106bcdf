"""Load a part
===========

A part from a file, and one from arrays. Prints sizes and what was assumed.
"""

import numpy as np

from polish_sim import load_part, part_from_arrays, workpiece_path

mesh = load_part(workpiece_path("freeform"), unit="mm", up="auto")
print("vertices [m]", mesh.vertices.shape, mesh.vertices.dtype)
print("faces       ", mesh.faces.shape, mesh.faces.dtype)
print("up          ", mesh.up)
for note in mesh.notes:
    print("note:", note)

# A wedge of 100 x 60 x 30 mm out of nothing but numpy.
corners = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [1, 0.6, 0], [0, 0.6, 0], [0, 0, 0.3], [0, 0.6, 0.3]])
faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [3, 5, 2], [1, 2, 5], [1, 5, 4], [0, 4, 5], [0, 5, 3]])
wedge = part_from_arrays(corners, faces, name="wedge", up="z")
print("wedge:", len(wedge.faces), "facets, up", wedge.up)
