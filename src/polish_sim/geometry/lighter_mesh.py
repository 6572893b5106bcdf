"""A mesh with fewer facets, to look at and not to measure on (vertices, faces -> fewer of both)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Ints


class LighterMesh(NamedTuple):
    """Triangles of a mesh or of a lighter copy."""

    vertices: Array  #: [m], shape (n, 3)
    faces: Ints  #: Vertex indices, shape (m, 3)


def lighter_mesh(vertices: Array, faces: Ints, most_facets: int) -> LighterMesh:
    """Collapse edges of a fine mesh (n, 3) [m], (m, 3), those that change the shape least first, to ``most_facets``.

    A mesh that is light enough stays as it is.
    """
    if len(faces) <= most_facets:
        return LighterMesh(vertices, faces)
    from fast_simplification import simplify  # slow to import

    size = float(np.ptp(vertices, axis=0).max())  # its tolerances are lengths
    points, triangles = simplify(vertices / size, faces.astype(np.int32), target_count=most_facets)
    return LighterMesh(size * points.astype(np.float64), triangles.astype(np.int32))
