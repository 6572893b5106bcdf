"""All repairs in their order: from a triangle soup to a skin one can plan on (triangles -> Skin)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from polish_sim.geometry.repair.facets import drop_bad_facets, flip_needles, flip_slivers, split_t_junctions
from polish_sim.geometry.repair.holes import close_holes, separate_crowded
from polish_sim.geometry.repair.scan_noise import smooth_noise
from polish_sim.geometry.repair.shells import describe_crossing_facets, describe_shells, turn_outward, wind_alike
from polish_sim.geometry.repair.skin import Floats, Skin, merge_vertices


def mend(triangles: Floats, path: Path) -> Skin:
    """Repair what can be repaired without guessing; say what was done and what was left.

    Args:
        triangles: Corners [m], shape (m, 3, 3).
        path: The file, for messages.

    Returns:
        The skin: every edge has one or two facets, wound alike, closed pieces outward. Borders, bodies and facets
        that pass through each other are left and noted.

    Raises:
        MeshError: Inside and outside cannot be told; names the place.
    """
    vertices, faces, notes = merge_vertices(triangles)
    skin = Skin(vertices, faces, np.arange(len(faces), dtype=np.int32), notes)
    skin = drop_bad_facets(skin, path)
    skin = wind_alike(skin, path)
    skin = wind_alike(separate_crowded(split_t_junctions(skin), path), path)
    skin = close_holes(flip_needles(flip_slivers(skin)))
    skin = turn_outward(skin)
    skin = smooth_noise(skin)
    return skin._replace(notes=(*skin.notes, *describe_shells(skin), *describe_crossing_facets(skin)))
