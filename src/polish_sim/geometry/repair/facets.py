"""Repairs of single facets that need no guessing: drop empty and double ones, flip slivers away (Skin -> Skin)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import MeshError
from polish_sim.geometry.repair.merge import number_rows
from polish_sim.geometry.repair.skin import Floats, Ints, Skin, place
from polish_sim.geometry.topology import facet_links, find_adjacency, label_pieces, sorted_half_edges

SLIVER = 1e-6
"""Facets lower than this share of the part's size have no meaningful normal."""

_FLIP_ROUNDS = 10


def drop_bad_facets(skin: Skin, path: Path) -> Skin:
    """Drop facets whose corners coincide and facets that occur twice.

    Of a facet that occurs twice one stays; where that leaves a wall inside the part (two solids glued at a
    face), both go.

    Raises:
        MeshError: No facet has an area.
    """
    if (facet_heights(skin.vertices, skin.faces) <= SLIVER * skin.size).all():
        raise MeshError(
            f"{path}: all {len(skin.faces)} facets have zero area (all points on a line or in one place). "
            "Export the part again."
        )
    whole = (skin.faces != np.roll(skin.faces, 1, axis=1)).all(axis=1)
    dropped = int((~whole).sum())
    if dropped:
        skin = skin.keep(whole, f"dropped {dropped} facets without area")
    first, number = number_rows(np.sort(skin.faces, axis=1).astype(np.uint64))
    if len(first) == len(skin.faces):
        return skin
    double = np.bincount(number)[number[first]] > 1
    twice = len(skin.faces) - len(first)
    where = place(skin.vertices[skin.faces[first[double][0]]])
    skin = skin.keep(first.astype(np.int32), f"dropped {twice} facets that occur twice, the first at {where}")
    return _drop_walls(skin, double)


def _drop_walls(skin: Skin, double: NDArray[np.bool_]) -> Skin:
    """Drop pieces of double facets whose rim others share, so that inside and outside are defined again."""
    _, _, order, key = sorted_half_edges(skin.faces)
    run = np.cumsum(np.concatenate([[True], key[1:] != key[:-1]])) - 1
    crowded = np.zeros(len(order), dtype=bool)
    crowded[order] = np.bincount(run)[run] > 2
    if not crowded.any():
        return skin
    adjacency = find_adjacency(skin.faces)
    both = double[:, None] & double[adjacency.facets]
    count, labels = label_pieces(facet_links(adjacency, both), len(skin.faces))
    wall = np.zeros(count, dtype=bool)
    wall[labels[double & crowded.reshape(-1, 3).any(axis=1)]] = True
    inner = wall[labels] & double
    if not inner.any():
        return skin
    return skin.keep(~inner, f"dropped {inner.sum()} facets of walls inside the part, where solids meet face to face")


def flip_slivers(skin: Skin) -> Skin:
    """Turn the long edge of facets without height, so that the skin stays closed without them.

    A corner that lies on its facet's long edge is connected to the facet beyond that edge instead.
    """
    vertices, limit = skin.vertices, SLIVER * skin.size
    faces, flips = skin.faces.copy(), 0
    for _ in range(_FLIP_ROUNDS):
        heights = facet_heights(vertices, faces)
        slivers = np.flatnonzero(heights <= limit)
        adjacency = find_adjacency(faces) if len(slivers) else None
        done: set[int] = set()
        for facet in slivers:
            assert adjacency is not None
            edge = int(_edge_lengths(vertices, faces[facet]).argmax())
            other = int(adjacency.facets[facet, edge])
            if other < 0 or done & {int(facet), other}:
                continue
            a, c, b = np.roll(faces[facet], -edge)
            d = faces[other, (adjacency.edges[facet, edge] + 2) % 3]
            pair = np.array([[b, a, d], [c, b, d]], dtype=np.int32)
            if b == d or facet_heights(vertices, pair).min() <= heights[facet]:
                continue
            faces[facet], faces[other] = pair
            done |= {int(facet), other}
        flips += len(done) // 2
        if not done:
            break
    notes = (*skin.notes, f"flipped the long edge of {flips} facets without height") if flips else skin.notes
    return Skin(vertices, faces, skin.source, notes)


def facet_heights(vertices: Floats, faces: Ints) -> Floats:
    """Smallest height of each facet [m], shape (m,)."""
    longest = _edge_lengths(vertices, faces).max(axis=-1)
    return np.linalg.norm(_area_vectors(vertices, faces), axis=1) / np.maximum(longest, 1e-300)


def _edge_lengths(vertices: Floats, faces: Ints) -> Floats:
    return np.linalg.norm(vertices[np.roll(faces, -1, axis=-1)] - vertices[faces], axis=-1)


def _area_vectors(vertices: Floats, faces: Ints) -> Floats:
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    return np.cross(b - a, c - a)
