"""Moving what the look-ahead keeps to the front of its buffers (layer 6)."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.buffers import Corners, Lines, Segments
from polish_sim.motion.rules.chain import Chain


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def move_line(lines: Lines, k: int, to: int, moved: int) -> None:
    """Line ``k``, its segments counted from number ``moved`` on, becomes line ``to``."""
    lines.first[to] = lines.first[k] - moved
    move_row(lines.spans, to, k)
    move_row(lines.limits, to, k)
    move_row(lines.rooms, to, k)


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def move_corner(corners: Corners, k: int, to: int) -> None:
    """Corner ``k`` becomes corner ``to``."""
    move_row(corners.durations, to, k)
    move_row(corners.remaining, to, k)
    move_row(corners.gone, to, k)
    move_row(corners.scales, to, k)
    move_row(corners.slowdowns, to, k)
    move_row(corners.states, to, k)
    move_row(corners.levels, to, k)
    move_row(corners.costs, to, k)
    move_row(corners.origins, to, k)
    move_row(corners.chosen, to, k)


@njit(cache=True, error_model="numpy", forceinline=True)
def move_row(rows: NDArray[Any], to: int, k: int) -> None:
    """Row ``k`` of an array over row ``to``, element by element: nothing is allocated."""
    flat, size = rows.reshape(-1), rows.size // rows.shape[0]
    for i in range(size):
        flat[to * size + i] = flat[k * size + i]


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def move_way_point(chain: Chain, k: int, to: int) -> None:
    """Way point ``k`` becomes way point ``to``."""
    move_row(chain.tips, to, k)
    move_row(chain.axes, to, k)
    move_row(chain.rotations, to, k)


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def move_segment(segments: Segments, k: int, to: int) -> None:
    """Segment ``k`` becomes segment ``to``."""
    chain = segments.chain
    move_row(chain.lengths, to, k)
    move_row(chain.directions, to, k)
    move_row(chain.angles, to, k)
    move_row(chain.turn_axes, to, k)
    move_row(chain.rolls, to, k)
    move_row(segments.spans, to, k)
    move_row(segments.limits, to, k)
    move_row(segments.bends, to, k)
    move_row(segments.used, to, k)
    move_row(segments.raw_ends, to, k)
