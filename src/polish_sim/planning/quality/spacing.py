"""How far neighbouring turns of a path lie apart, and what step-over a foreign path was made with (runs ->
figures)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, crosses, dots, foot_on_chord, unit
from polish_sim.kernel_cache import njit
from polish_sim.kernels import dot, minus
from polish_sim.planning.curve import Curve
from polish_sim.planning.points import build_point_grid, cells_between
from polish_sim.planning.quality.located import RunSamples, Strands
from polish_sim.planning.toolpath import ToolPath, stretches

SAMPLES = 8  #: Samples per step-over along the path
OWN_STRETCH = 2.0  #: Points closer than this many step-overs along the path belong to the same turn
#: A neighbour further away than this many step-overs is no neighbour; `AreaAccount.far` shows such gaps
FURTHEST = 2.0
SHARP = np.radians(60.0)  #: Change of direction of a corner of 120 deg [rad]


class Stepover(NamedTuple):
    """Distances to the adjacent turns, on either side; nan where there are none."""

    min_m: float
    p5_m: float
    mean_m: float
    p95_m: float
    max_m: float
    #: Share of the path left out: corners sharper than 120 deg and the last half turn of each run
    excluded: float
    distances_m: Array  #: All of them, shape (k,)


def measure_stepover(runs: Sequence[Curve], stepover: float) -> Stepover:
    """Distances from points of the path's runs in contact to the adjacent turn on either side.

    ``stepover`` [m] is what was planned, or expected.
    """
    strands = Strands(runs)
    path = strands.sample(stepover / SAMPLES)
    sides = crosses(path.normals, unit(along(path)))
    sides_of = neighbours_beside(path, sides, stepover)
    out = _corners(path) | _last_half_turns(path, sides_of)
    found = [
        _refine(strands, path, beside, ~out & (beside >= 0) & ~out[beside], stepover) for beside in sides_of
    ]
    return stepover_of(np.concatenate(found), out.mean())


def stepover_of(kept: Array, excluded: float) -> Stepover:
    """The figures of some distances (k,) [m], a share of the path left out."""
    if len(kept) == 0:
        return Stepover(*5 * (np.nan,), excluded, kept)
    p5, p95 = np.percentile(kept, [5.0, 95.0])
    return Stepover(kept.min(), p5, kept.mean(), p95, kept.max(), excluded, kept)


def along(path: RunSamples) -> Array:
    """Central differences along each run, shape (n, 3)."""
    before, after = _samples_off(path, 1)
    return path.points[after] - path.points[before]


def _samples_off(path: RunSamples, steps: int) -> tuple[Indices, Indices]:
    """The samples some steps before and after each, those at the ends of its run at most, (n,) each."""
    rows = np.arange(len(path.run))
    before = np.maximum(rows - steps, path.first[path.run])
    return before, np.minimum(rows + steps, path.first[path.run + 1] - 1)


def _corners(path: RunSamples) -> Bools:
    """Points within half a step-over of a place where the path turns by more than 60 deg within one."""
    from scipy.ndimage import binary_dilation  # slow to import

    half = SAMPLES // 2
    before, after = _samples_off(path, half)
    ways = path.points - path.points[before], path.points[after] - path.points
    sharp = dots(*map(unit, ways)) < np.cos(SHARP)
    sharp &= after - before == 2 * half
    return binary_dilation(sharp, iterations=half)


def neighbours_beside(path: RunSamples, sides: Array, stepover: float) -> tuple[Indices, Indices]:
    """The nearest sample of another turn on the left and on the right of each sample, -1 where there is
    none."""
    reach = FURTHEST * stepover
    grid = build_point_grid(path.points, 0.5 * reach)
    own = OWN_STRETCH * stepover
    return _nearest_beside(path.points, sides, path.run, path.s, grid, reach, own)


@njit
def _nearest_beside(points, sides, run, s, grid, reach, own):  # type: ignore[no-untyped-def]
    found = np.full((2, len(points)), -1, np.int64)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        i0, i1 = cells_between(grid, 0, x - reach, x + reach)
        j0, j1 = cells_between(grid, 1, y - reach, y + reach)
        k0, k1 = cells_between(grid, 2, z - reach, z + reach)
        left, right = reach * reach, reach * reach
        for a in range(i0, i1):
            for b in range(j0, j1):
                row = (a * grid.size[1] + b) * grid.size[2]
                for q in range(grid.first[row + k0], grid.first[row + k1]):
                    j = grid.items[q]
                    if run[j] == run[i] and abs(s[j] - s[i]) <= own:
                        continue
                    gap = minus(points[j], points[i])
                    far2 = dot(gap, gap)
                    if far2 >= left and far2 >= right:
                        continue
                    towards = dot(gap, sides[i])
                    beside = 0.25 * np.sqrt(far2)
                    if towards > beside and far2 < left:
                        left = far2
                        found[0, i] = j
                    elif -towards > beside and far2 < right:
                        right = far2
                        found[1, i] = j
    return found[0], found[1]


def _last_half_turns(path: RunSamples, sides: tuple[Indices, Indices]) -> Bools:
    """The second half of the turn that a run closes around its own end, as a spiral does in the middle."""
    out = np.zeros(len(path.s), dtype=bool)
    for first, last in zip(path.first[:-1], path.first[1:] - 1, strict=True):
        beside = [side[last] for side in sides if side[last] >= 0 and path.run[side[last]] == path.run[last]]
        turns = [j for j in beside if _is_one_turn(path, j, last)]
        turn = max((path.s[last] - path.s[j] for j in turns), default=0.0)
        out[first : last + 1] = path.s[first : last + 1] > path.s[last] - 0.5 * turn
    return out


def _is_one_turn(path: RunSamples, first: int, last: int) -> bool:
    """Whether a run goes round about once between two of its samples: not to and fro, not round and round."""
    rows = np.arange(first, last + 1, SAMPLES // 2)
    ways = np.diff(path.points[rows], axis=0)
    normals = path.normals[rows[1:-1]]
    across = dots(crosses(ways[:-1], ways[1:]), normals)
    turns = np.arctan2(across, dots(ways[:-1], ways[1:]))
    return bool(abs(turns.sum()) > 1.5 * np.pi and np.abs(turns).sum() < 4.0 * np.pi)


def _refine(strands: Strands, path: RunSamples, beside: Indices, wanted: Bools, stepover: float) -> Array:
    """Distances to the neighbouring turn itself instead of its nearest sample."""
    rows = np.flatnonzero(wanted)
    run, s, points = path.run[beside[rows]], path.s[beside[rows]], path.points[rows]
    best = np.full(len(rows), np.inf)
    # The foot on two chords about the best place so far; each time the chords are a fourth as long.
    reach = stepover / SAMPLES
    for _ in range(3):
        knots = [strands.at(run, s + shift)[0] for shift in (-reach, 0.0, reach)]
        nearer = np.full(len(rows), np.inf)
        moved = s
        for k in (0, 1):
            chord = knots[k + 1] - knots[k]
            share, gap = foot_on_chord(points - knots[k], chord)
            moved = np.where(gap < nearer, s + (k - 1 + share) * reach, moved)
            nearer = np.minimum(gap, nearer)
        s, best = np.clip(moved, 0.0, strands.lengths[run]), nearer
        reach *= 0.25
    return best


# The step-over a path of unknown origin was made with, from the path itself (ToolPath -> metres).

ASKED = 2000  #: Places along the path at which its neighbours are looked for
NEIGHBOURS = 64
COARSER = (1.0, 4.0, 16.0)  #: Distances of the neighbours [samples of the turn] beyond which fewer samples do
ROUNDS = 8
FINE = 0.25  #: Samples are fine enough at this share of the step-over
MOST_SAMPLES = 500_000
SIDEWAYS = 0.5  #: Largest share of the way to a neighbour that may lie along the path
LOOP = 3.0  #: Least ratio of the distance along the path to the straight one for a neighbour on the same run


def guess_stepover(path: ToolPath) -> float | None:
    """Median distance between neighbouring turns of a path [m]; None if no stretch of it runs beside
    another."""
    rows = [slice(first, last + 1) for first, last in stretches(path.process) if path.s[last] > path.s[first]]
    if not rows:
        return None
    # No surface yet: the tool axis stands in for its normal.
    runs = [Curve(path.positions_work[some], path.axes_work[some], False) for some in rows]
    strands = Strands(runs)
    total = strands.lengths.sum()
    for coarse in COARSER:
        guess = _refined_guess(strands, total, coarse * total / ASKED)
        if guess is not None:
            exact = measure_stepover(runs, guess).distances_m
            return np.median(exact) if len(exact) else None
    return None


def _refined_guess(strands: Strands, total: float, spacing: float) -> float | None:
    """The guess from samples at first a spacing apart [m], then ever finer until they separate the turns."""
    guess = None
    for _ in range(ROUNDS):
        guess = _guess(strands.sample(spacing))
        if guess is None or spacing <= 1.5 * FINE * guess or total / spacing > MOST_SAMPLES:
            break
        spacing = FINE * guess
    return guess


def _guess(path: RunSamples) -> float | None:
    """Median distance from some samples to the nearest one of another turn."""
    asked = np.unique(np.linspace(0, len(path.s) - 1, ASKED).astype(np.int64))
    tangents = unit(along(path)[asked])
    count = min(NEIGHBOURS, len(path.s))
    distance, index = cKDTree(path.points).query(path.points[asked], k=count)
    towards = path.points[index] - path.points[asked, None]
    ahead = np.abs(dots(towards, tangents[:, None]))
    far = np.abs(path.s[index] - path.s[asked, None]) > LOOP * distance
    other = (far | (path.run[index] != path.run[asked, None])) & (ahead < SIDEWAYS * distance)
    found = other.any(axis=1)
    if found.mean() < 0.05:
        return None
    return np.median(distance[found, other[found].argmax(axis=1)])
