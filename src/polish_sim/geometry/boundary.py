"""Border of a surface as ordered closed lines, the outer one first (Surface -> polylines)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry.surface import Surface

Floats = NDArray[np.float64]

CHORD_ERROR = 1e-5
"""Curved border edges are divided until the polyline is this close to them [m]."""


def boundary_loops(surface: Surface, up: Floats) -> tuple[Floats, ...]:
    """Trace the border.

    Args:
        surface: An open surface.
        up: Unit vector; the loop that encloses the largest area seen from there is the outer one, shape (3,).

    Returns:
        Closed polylines [m], each (p, 3) with the first point repeated at the end, the surface to the left
        seen from outside; the outer loop first. None for a closed surface.
    """
    loops = [_sample(surface, loop) for loop in _trace(surface)]
    loops.sort(key=lambda loop: -abs(_enclosed(loop, up)))
    for loop in loops:
        loop.setflags(write=False)
    return tuple(loops)


def _trace(surface: Surface) -> list[list[tuple[int, int]]]:
    """Border edges (facet, edge) in the order one walks along them."""
    left = {(int(f), int(e)) for f, e in zip(*np.nonzero(surface.neighbours < 0), strict=True)}
    loops = []
    while left:
        start = min(left)
        loop, here = [], start
        while here in left:
            left.remove(here)
            loop.append(here)
            here = _next_border_edge(surface, here)
        loops.append(loop)
    return loops


def _next_border_edge(surface: Surface, border_edge: tuple[int, int]) -> tuple[int, int]:
    """Turn around the edge's end, from facet to facet, until the border is met again."""
    facet, edge = border_edge[0], (border_edge[1] + 1) % 3
    while surface.neighbours[facet, edge] >= 0:
        facet, edge = int(surface.neighbours[facet, edge]), (int(surface.neighbour_edges[facet, edge]) + 1) % 3
    return facet, edge


def _sample(surface: Surface, loop: list[tuple[int, int]]) -> Floats:
    """Points along the loop, more where its edges are curved."""
    pieces = []
    for facet, edge in loop:
        start, end = surface.control[facet, edge], surface.control[facet, (edge + 1) % 3]
        control = surface.control[facet, 3 + edge]
        sagitta = 0.5 * float(np.linalg.norm(control - 0.5 * (start + end)))
        parts = int(np.clip(np.ceil(np.sqrt(sagitta / CHORD_ERROR)), 1, 64))
        t = (np.arange(parts) / parts)[:, None]
        pieces.append((1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end)
    points = np.concatenate(pieces)
    return np.concatenate([points, points[:1]])


def _enclosed(loop: Floats, up: Floats) -> float:
    """Signed area a closed loop encloses seen from above [m^2]."""
    return 0.5 * float(np.cross(loop[:-1] - loop[0], loop[1:] - loop[0]).sum(axis=0) @ up)
