"""`python -m benchmarks.corner_kernels FILE.png`: corner kernels at the trial's limits, and how much time they lose."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numba import njit
from numpy.typing import NDArray

from polish_sim.analysis.style import BLUE, GREEN, GREY, head, line_look, new_figure, styled
from polish_sim.motion.certified.connector import Peaks
from polish_sim.motion.certified.corner import CornerShapes, corner_kernel, corner_shapes, time_lost
from polish_sim.motion.certified.kernel import FAR, Corner, Figures, Kernel, side_of

Array = NDArray[np.float64]

LINE = Peaks(0.05, 0.5, 10.0)
TOLERANCE = 2e-5
AXIS, AXIS_TOLERANCE = Peaks(*np.radians([10.0, 100.0, 2000.0])), np.radians(0.02)
TURNS = (15.0, 45.0, 90.0, 135.0)
_MM = 1e3


class Sampled(NamedTuple):
    """A kernel of a turn in the plane, sampled: positions a and b [m], their derivatives, times [s]."""

    figures: Figures
    lost: float
    times: Array
    remaining: Array
    gone: Array


def corner_of(tip: float, axis: float, cosine: float) -> Corner:
    """A corner of long segments with these rates of tip and axis per generalised length, at the trial's limits."""
    sides = side_of(tip, tip, cosine, LINE, TOLERANCE, False), side_of(axis, axis, cosine, AXIS, AXIS_TOLERANCE, True)
    return Corner(*sides, LINE, FAR)


def kernel_of(shapes: CornerShapes, turn: float) -> Sampled:
    """Round a turn [rad] of the tip and sample it: rows of a and b are derivatives 0 to 3."""
    kernel = Kernel()
    durations, a, b = kernel.durations, kernel.remaining, kernel.gone
    figures = corner_kernel(corner_of(1.0, 0.0, float(np.cos(turn))), shapes, kernel)
    t = durations[:, None] * np.linspace(0.0, 1.0, 40)
    times = (t + (np.cumsum(durations) - durations)[:, None]).ravel()
    return Sampled(figures, time_lost(figures, LINE), times, _derivatives(a, t), _derivatives(b, t))


def _derivatives(pieces: Array, t: Array) -> Array:
    """Derivatives 0 to 3 of cubic pieces, shape (4, n)."""
    c0, c1, c2, c3 = (pieces[:, i : i + 1] for i in range(4))
    rows = [c0 + t * (c1 + t * (c2 + t * c3)), c1 + t * (2 * c2 + 3 * t * c3), 2 * c2 + 6 * t * c3, 6 * c3 + 0 * t]
    return np.array([row.ravel() for row in rows])


@styled
def plot_kernels(shapes: CornerShapes) -> Figure:
    """Paths in the corner, speed, acceleration and jerk of four turns."""
    figure = new_figure(12.0, 7.6)
    axes = figure.subplots(3, len(TURNS), squeeze=False, sharey="row")
    for column, degrees in enumerate(TURNS):
        turn = float(np.radians(degrees))
        kernel = kernel_of(shapes, turn)
        axes[0, column].set_title(f"{degrees:g} deg, {kernel.lost * 1e3:.1f} ms lost")
        _plot_path(axes[0, column], kernel, turn)
        _plot_distance(axes[1, column], kernel, turn)
        _plot_shares(axes[2, column], kernel, turn)
    for row, meaning in enumerate(("y [mm]", "distance to the line,\ninside + [mm]", "share of the limit")):
        axes[row, 0].set_ylabel(meaning)
    head(figure, f"Corners rounded within {TOLERANCE * _MM:g} mm", legend=(axes[0, 0], axes[1, 0], axes[2, 0]))
    return figure


def _along(kernel: Sampled, turn: float, order: int) -> tuple[Array, Array]:
    """A derivative of the tip, x along the old segment."""
    a, b = kernel.remaining[order], kernel.gone[order]
    return -a + b * np.cos(turn), b * np.sin(turn)


def _plot_path(axes: Axes, kernel: Sampled, turn: float) -> None:
    """The tip round the vertex, a few tolerances wide."""
    x, y = _along(kernel, turn, 0)
    leg = 8 * TOLERANCE * _MM
    axes.plot([-leg, 0, 2 * leg * np.cos(turn)], [0, 0, 2 * leg * np.sin(turn)], color=GREY, label="path")
    axes.plot(x * _MM, y * _MM, color=BLUE, label="tip")
    axes.set(xlim=(-leg, leg), ylim=(-0.4 * leg, leg), xlabel="x [mm]")
    axes.set_aspect("equal", adjustable="box")


def _plot_distance(axes: Axes, kernel: Sampled, turn: float) -> None:
    """Distance to the old line in the first half, to the new one in the second, with sign."""
    distance = np.where(np.abs(kernel.remaining[0]) > np.abs(kernel.gone[0]), kernel.gone[0], kernel.remaining[0])
    axes.plot(kernel.times * 1e3, distance * np.sin(turn) * _MM, color=BLUE)
    for side in (-1, 1):
        axes.axhline(side * TOLERANCE * _MM, color=GREEN, linestyle="--", label="tolerance")
    axes.set(xlabel="time [ms]")


def _plot_shares(axes: Axes, kernel: Sampled, turn: float) -> None:
    """Norms of speed, acceleration and jerk as shares of their limits."""
    for order, name in enumerate(("speed", "acceleration", "jerk"), start=1):
        share = np.hypot(*_along(kernel, turn, order)) / LINE[order - 1]
        axes.plot(kernel.times * 1e3, share, label=name, **line_look(order - 1))
    axes.set(xlabel="time [ms]", ylim=(0, 1.25))


@njit
def _round_many(count: int, corner: Corner, shapes: CornerShapes, kernel: Kernel) -> float:
    """Round the same corner many times."""
    speed = 0.0
    for _ in range(count):
        speed += corner_kernel(corner, shapes, kernel).speed
    return speed


def microseconds(shapes: CornerShapes, corner: Corner, count: int = 20000) -> float:
    """Time of one corner, the best of five [us]."""
    kernel = Kernel()
    _round_many(1, corner, shapes, kernel)
    best = np.inf
    for _ in range(5):
        start = time.perf_counter()
        _round_many(count, corner, shapes, kernel)
        best = min(best, time.perf_counter() - start)
    return best / count * 1e6


def main() -> None:
    shapes = corner_shapes()
    plot_kernels(shapes).savefig(Path(sys.argv[1]))
    print("  turn [deg]   lost [ms]   size [mm]   speed [mm/s]")
    for degrees in (3, 10, 15, 20, 30, 45, 60, 75, 90, 120, 150, 180):
        kernel = kernel_of(shapes, float(np.radians(degrees)))
        print(
            f"{degrees:12d}{kernel.lost * 1e3:12.1f}{kernel.figures.size * _MM:12.2f}{kernel.figures.speed * _MM:15.1f}"
        )
    print(f"  one corner, tip only: {microseconds(shapes, corner_of(1.0, 0.0, 0.3)):.2f} us")
    print(f"  tip and axis: {microseconds(shapes, corner_of(1.0, 3.4, 0.3)):.2f} us")
    print(f"  axis first: {microseconds(shapes, corner_of(0.2, 3.49, 0.3)):.2f} us")


if __name__ == "__main__":
    main()
