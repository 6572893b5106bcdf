"""Border of a surface as ordered closed lines, the outer one first (Surface -> polylines)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry.surface import Surface
from polish_sim.geometry.topology import Adjacency, facet_links, label_pieces

Floats = NDArray[np.float64]

CHORD_ERROR = 1e-5
"""Curved border edges are divided until the polyline is this close to them [m]."""


def boundary_loops(surface: Surface) -> tuple[Floats, ...]:
    """Trace the border.

    Args:
        surface: An open surface, in one or several pieces.

    Returns:
        Closed polylines [m], each (p, 3) with the first point repeated at the end, the surface to the left
        seen from outside; piece by piece, of each the outer loop first, the one that encloses the largest area
        seen from where that looks largest. None for a closed surface.
    """
    traced = _trace(surface)
    loops = [_sample(surface, loop) for loop in traced]
    piece = connected_facets(surface)
    of_piece = [int(piece[loop[0][0]]) for loop in traced]
    areas = np.array([enclosed(loop) for loop in loops])
    # Holes of one size keep their order, however rounding has it.
    sizes = np.round(areas / areas.max(initial=1e-300), 6)
    order = sorted(range(len(loops)), key=lambda at: (of_piece[at], -sizes[at]))
    for loop in loops:
        loop.setflags(write=False)
    return tuple(loops[at] for at in order)


def connected_facets(surface: Surface, passable: NDArray[np.bool_] | None = None) -> NDArray[np.int32]:
    """Number of the connected piece each facet belongs to, shape (m,); the largest piece is 0.

    Args:
        surface: The surface.
        passable: Edges across which pieces hang together, shape (m, 3); None for all.
    """
    adjacency = Adjacency(surface.neighbours, surface.neighbour_edges)
    count, labels = label_pieces(facet_links(adjacency, passable), len(surface.faces))
    areas = np.bincount(labels, weights=surface.facet_areas, minlength=count)
    # Pieces of one area keep their order, however rounding has it.
    order = np.argsort(-np.round(areas / areas.max(initial=1e-300), 6), kind="stable")
    rank = np.empty(count, dtype=np.int32)
    rank[order] = np.arange(count)
    return rank[labels]


def enclosed(loop: Floats) -> float:
    """Largest area a closed loop (p, 3) encloses from any side it is seen from [m^2]."""
    return 0.5 * float(np.linalg.norm(np.cross(loop[:-1] - loop[0], loop[1:] - loop[0]).sum(axis=0)))


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
