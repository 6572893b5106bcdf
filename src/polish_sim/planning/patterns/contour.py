"""Closed loops one inside the other, each closed exactly, joined by short slanting steps (pattern; Region ->
runs)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polish_sim.arrays import Array, angles_between, norms, running_sums
from polish_sim.config import PlanConfig
from polish_sim.geometry import Surface
from polish_sim.planning.curve import Curve
from polish_sim.planning.offset_curve import adapted_spacing
from polish_sim.planning.patterns.nested import CANDIDATES, chains, lines_across, nested_turns
from polish_sim.planning.patterns.run import (
    FINE,
    FURTHEST_M,
    ROUNDING,
    SHARPENING,
    PatternRequest,
    SurfaceRun,
    averaged_twice,
)

STEP_LENGTH = 1.25  #: Length of the step from loop to loop along them, in step-overs
SHARE_OF_LOOP = 0.15  #: It is at most this share of the smaller loop
FURTHEST_STEP = 1.8  #: Where a loop's neighbour is further away than this many step-overs the tool is lifted
#: A wish to step far from corners: a corner costs as much as this many step-overs from the wanted start
CORNER = 30.0


def contour_runs(request: PatternRequest) -> list[SurfaceRun]:
    """Cover a region with closed loops; one run for each chain of loops inside one another."""
    plan, surface = request.plan, request.region.surface
    outward = plan.order == "outward"
    # With what is not done yet on the left, loops that go inwards have the inside on their left.
    reverse = outward != (plan.direction == "climb")
    runs = []
    for chain in chains(nested_turns(request).roots, request.stepover):
        loops = [_rounded(surface, turn.curve, request.stepover, reverse) for turn in chain]
        starts = _starts(loops, request.stepover, outward, plan)
        runs += _joined(surface, loops, starts, request.stepover, outward)
    return runs[::-1] if outward else runs


def _rounded(surface: Surface, turn: Curve, stepover: float, reverse: bool) -> Curve:
    """A turn with round corners and points of equal chord error, on the surface."""
    even = turn.points(turn.even(FINE * stepover, 12))
    window = min(round(ROUNDING / FINE), len(even) // 6) | 1
    sharpened = even + SHARPENING * (even - averaged_twice(even, window, "wrap"))
    on = surface.closest(averaged_twice(sharpened, window, "wrap"))
    smooth = Curve(on.positions, on.normals, True)
    chords = adapted_spacing(smooth, min(stepover, 8.0 * FURTHEST_M))
    found = surface.closest(smooth.points(running_sums(chords)[:-1]))
    loop = Curve(found.positions, found.normals, True)
    return loop.backwards() if reverse else loop


def _starts(loops: Sequence[Curve], stepover: float, outward: bool, plan: PlanConfig) -> list[float]:
    """Where each loop begins: on a line traced outwards from the innermost, nearest point to nearest
    point."""
    sign = 1.0 if outward else -1.0
    start = np.reshape(() if outward else plan.start, (-1, 3))

    def slant(inner: Curve, outer: Curve) -> float:
        return sign * _step_length(inner, outer, stepover)

    lines = lines_across(loops, CANDIDATES, start, stepover, slant)
    cost = sum(_sharpness(loop, s, stepover) for loop, s in zip(loops, lines, strict=True))
    for outer, inner, s in zip(loops[:-1], loops[1:], lines[1:], strict=True):
        cost = cost + np.maximum(outer.nearest(inner.points(s)).distances / stepover - 1.1, 0.0)
    if plan.start:
        begin = -1 if outward else 0
        places = loops[begin].points(lines[begin])
        cost = cost + CORNER * norms(places - np.array(plan.start)) / stepover
    best = np.argmin(np.round(cost, 6))
    return [line[best] for line in lines]


def _step_length(inner: Curve, outer: Curve, stepover: float) -> float:
    return min(STEP_LENGTH * stepover, SHARE_OF_LOOP * min(inner.length, outer.length))


def _sharpness(loop: Curve, s: Array, stepover: float) -> Array:
    """How much a loop turns within a step-over around places, beyond 30 deg [rad]."""
    ahead, behind = (loop.tangents(s + shift * stepover, 0.25 * stepover) for shift in (1.0, -1.0))
    return np.maximum(angles_between(ahead, behind) - np.radians(30.0), 0.0)


def _joined(
    surface: Surface, loops: Sequence[Curve], starts: Sequence[float], stepover: float, outward: bool
) -> list[SurfaceRun]:
    """Loops in their order, with steps between them where they lie side by side."""
    rows = list(range(len(loops)))[:: -1 if outward else 1]
    parts: list[list[tuple[Array, int]]] = [[]]
    for number, k in enumerate(rows):
        lap = loops[k].between(starts[k], starts[k] + loops[k].length)
        lap[-1] = lap[0]
        parts[-1].append((lap, number))
        if number + 1 == len(rows):
            break
        following = rows[number + 1]
        step = _step(loops[k], starts[k], loops[following], starts[following], stepover)
        if step is None:
            parts.append([])
        else:
            parts[-1].append((step, number))
    runs = []
    for part in parts:
        points = surface.closest(np.concatenate([positions for positions, _ in part]))
        runs.append(
            SurfaceRun(surface, points, np.repeat([number for _, number in part], [len(p) for p, _ in part]))
        )
    return runs


def _step(here: Curve, s: float, there: Curve, arrive: float, stepover: float) -> Array | None:
    """Slanting way from one loop to a place on the next, without its ends; None if it is too long."""
    foot = there.nearest(here.points(np.array([s]))).s[0]
    length = _step_length(here, there, stepover)
    ahead = np.mod(arrive - foot, there.length)
    gap = np.linalg.norm(there.points(np.array([arrive])) - here.points(np.array([s + length])))
    if gap > FURTHEST_STEP * stepover:
        return None
    if ahead > 3.0 * length:
        ahead = min(length, SHARE_OF_LOOP * there.length)
    share = np.linspace(0.0, 1.0, max(int(2.0 * length / FURTHEST_M), 8) + 1)[1:-1]
    from_here, from_there = here.points(s + share * length), there.points(arrive - (1.0 - share) * ahead)
    return from_here + share[:, None] * (from_there - from_here)
