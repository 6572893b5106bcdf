"""Flip the long edge of needle facets, whose normals are far off on a curved face (Skin -> Skin)."""

from __future__ import annotations

import numpy as np
from numba import njit

from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.repair.skin import Floats, Ints, Skin, place
from polish_sim.geometry.topology import find_adjacency

NEEDLE = 0.1
"""A facet lower than this share of its longest edge is a needle."""

_CALMER = 0.5  # the sharpest edge around must get this much smaller [rad / rad], so that creases stay where they are
_DEEPEST = 0.03  # the new edge passes the old one at most at this share of its length
_ROUNDS = 10


def flip_needles(skin: Skin) -> Skin:
    """Connect the corner of a needle that lies near its long edge with the facet beyond that edge instead.

    Done only where both facets become rounder and the sharpest bend around them clearly smaller: on planes and at
    creases nothing changes. No vertex is moved.

    Returns:
        The skin, with a note of how many edges were flipped, and where the first is.
    """
    faces, flips, first = skin.faces.copy(), 0, -1
    for _ in range(_ROUNDS):
        adjacency = find_adjacency(faces)
        normals, _ = facet_normals(skin.vertices, faces)
        done, facet = _flip(skin.vertices, faces, adjacency.facets, adjacency.edges, normals)
        first = int(facet) if first < 0 else first
        flips += int(done)
        if not done:
            break
    if not flips:
        return skin
    where = place(skin.vertices[faces[first]])
    return Skin(
        skin.vertices,
        faces,
        skin.source,
        (*skin.notes, f"flipped the long edge of {flips} needles, the first at {where}"),
    )


@njit(cache=True, error_model="numpy")
def _flip(vertices: Floats, faces: Ints, neighbours: Ints, edges: Ints, normals: Floats):  # type: ignore[no-untyped-def]
    """One round of flips in place, none beside another; how many, and the first facet (-1: none)."""
    locked = np.zeros(len(faces), np.bool_)
    flips, first = 0, -1
    for facet in range(len(faces)):
        a, b, c = vertices[faces[facet, 0]], vertices[faces[facet, 1]], vertices[faces[facet, 2]]
        before, edge, _, _, _ = _measure(a, b, c)
        if before >= NEEDLE or locked[facet]:
            continue
        other = neighbours[facet, edge]
        if other < 0 or locked[other]:
            continue
        back = edges[facet, edge]
        p, q, r = faces[facet, edge], faces[facet, (edge + 1) % 3], faces[facet, (edge + 2) % 3]
        s = faces[other, (back + 2) % 3]
        if s == r or _linked(faces, neighbours, edges, facet, (edge + 2) % 3, s):
            continue
        # Facets p q r and q p s become s r p and r s q.
        shape_1, _, x1, y1, z1 = _measure(vertices[s], vertices[r], vertices[p])
        shape_2, _, x2, y2, z2 = _measure(vertices[r], vertices[s], vertices[q])
        other_shape, _, _, _, _ = _measure(
            vertices[faces[other, 0]], vertices[faces[other, 1]], vertices[faces[other, 2]]
        )
        if min(shape_1, shape_2) <= min(before, other_shape):
            continue
        if not _pass_closely(vertices[p], vertices[q], vertices[r], vertices[s]):
            continue
        beyond = (
            neighbours[facet, (edge + 2) % 3],
            neighbours[other, (back + 1) % 3],
            neighbours[facet, (edge + 1) % 3],
            neighbours[other, (back + 2) % 3],
        )
        sharpest = _bend(normals[facet, 0], normals[facet, 1], normals[facet, 2], normals[other])
        sharpest_after = _bend(x1, y1, z1, np.array([x2, y2, z2]))
        clear = True
        for k in range(4):
            if beyond[k] < 0:
                continue
            clear = clear and not locked[beyond[k]]
            old = facet if k in (0, 2) else other
            sharpest = max(sharpest, _bend(normals[old, 0], normals[old, 1], normals[old, 2], normals[beyond[k]]))
            x, y, z = (x1, y1, z1) if k < 2 else (x2, y2, z2)
            sharpest_after = max(sharpest_after, _bend(x, y, z, normals[beyond[k]]))
        if not clear or sharpest_after > _CALMER * sharpest:
            continue
        faces[facet, 0], faces[facet, 1], faces[facet, 2] = s, r, p
        faces[other, 0], faces[other, 1], faces[other, 2] = r, s, q
        locked[facet] = locked[other] = True
        for k in range(4):
            if beyond[k] >= 0:
                locked[beyond[k]] = True
        first = facet if flips == 0 else first
        flips += 1
    return flips, first


@njit(cache=True, error_model="numpy")
def _linked(faces, neighbours, edges, facet, corner, vertex):  # type: ignore[no-untyped-def]
    """Whether a corner's vertex has an edge to another vertex already, seen by walking around it both ways."""
    for way in range(2):
        at, here = facet, corner
        for _ in range(64):
            if faces[at, (here + 1) % 3] == vertex or faces[at, (here + 2) % 3] == vertex:
                return True
            side = here if way == 0 else (here + 2) % 3
            beyond = neighbours[at, side]
            if beyond < 0:
                break
            # The edge runs the other way there: the corner is its end (way 0) or its start.
            here = (edges[at, side] + 1) % 3 if way == 0 else edges[at, side]
            at = beyond
            if at == facet:
                return False
    return False


@njit(cache=True, error_model="numpy")
def _pass_closely(p, q, r, s):  # type: ignore[no-untyped-def]
    """Whether the lines p q and r s pass each other closely, seen against p q's length."""
    u, v, w = q - p, s - r, r - p
    x, y, z = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    cross2 = x * x + y * y + z * z
    return (x * w[0] + y * w[1] + z * w[2]) ** 2 <= _DEEPEST**2 * (u * u).sum() * cross2


@njit(cache=True, error_model="numpy")
def _measure(a, b, c):  # type: ignore[no-untyped-def]
    """Height over longest edge, which edge that is (from corner 0, 1 or 2), and the unit normal."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size = np.sqrt(x * x + y * y + z * z)
    ab, ca = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    bc = (ux - vx) ** 2 + (uy - vy) ** 2 + (uz - vz) ** 2
    longest, edge = ab, 0
    if bc > longest:
        longest, edge = bc, 1
    if ca > longest:
        longest, edge = ca, 2
    size_1 = max(size, 1e-300)
    return size / max(longest, 1e-300), edge, x / size_1, y / size_1, z / size_1


@njit(cache=True, error_model="numpy")
def _bend(x, y, z, normal):  # type: ignore[no-untyped-def]
    """Angle between two unit normals [rad]."""
    return np.arccos(min(max(x * normal[0] + y * normal[1] + z * normal[2], -1.0), 1.0))
