"""A payload's calibration as pictures: residuals pose by pose, drift over the calibration and over a long
run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polish_sim.analysis.style import (
    AXIS_COLORS,
    DASHES,
    GREEN,
    GREY,
    MARKS,
    head,
    new_figure,
    small_title,
    styled,
)
from polish_sim.arrays import Array, Bools

AXES = "xyz"


@styled
def plot_residuals(
    time: Array, residuals: Array, noise: Array, used: Bools, returned: bool, facts: Sequence[str]
) -> Figure:
    """Residuals of force and torque in every pose, and over time, with bands of one and two noise deviations.

    Args:
        time: Of the readings [s], shape (n,).
        residuals: What is left of them after the fit [N, N m], shape (n, 6).
        noise: Standard deviation of one reading [N, N m], shape (6,).
        used: Which readings the fit rests on, shape (n,).
        returned: Whether the last reading is in the first one's pose.
        facts: Figures for the head.
    """
    figure = new_figure(10.0, 6.0)
    grid = figure.subplots(2, 2, sharey="row", width_ratios=(1.35, 1.0))
    number = np.arange(1, len(time) + 1)
    groups = ((slice(0, 3), 1.0, "force residual [N]"), (slice(3, 6), 1e3, "torque residual [mN m]"))
    for (bars, over_time), (rows, scale, label) in zip(grid, groups, strict=True):
        values = residuals[:, rows] * scale
        deviation = noise[rows][0] * scale
        for axes in (bars, over_time):
            _noise_band(axes, deviation)
        for axis in range(3):
            bars.bar(
                number + 0.25 * (axis - 1), values[:, axis], 0.22, color=AXIS_COLORS[axis], label=AXES[axis]
            )
            over_time.plot(
                time,
                values[:, axis],
                MARKS[axis] + "-",
                color=AXIS_COLORS[axis],
                ms=4,
                lw=0.9,
                label=AXES[axis],
            )
        for k in np.flatnonzero(~used):
            bars.axvspan(k + 0.55, k + 1.45, color=GREY, alpha=0.35, lw=0)
            over_time.axvline(time[k], color=GREY, alpha=0.5, lw=4)
        bars.set_ylabel(label)
        bars.set_xlim(0.3, len(number) + 0.7)
        # An outlier would flatten everything else.
        reach = max(4.0 * deviation, 1.1 * np.abs(values[used]).max(initial=0.0), 1e-9)
        bars.set_ylim(-reach, reach)
    grid[1, 0].set_xlabel("reading" + (" (the last is in the first one's pose)" if returned else ""))
    grid[1, 1].set_xlabel("time [s]; a slope would be drift")
    head(figure, "Calibration of the payload", facts, legend=grid[0, 1:])
    return figure


def _noise_band(axes: Axes, noise: float) -> None:
    for times, alpha, name in ((2.0, 0.10, "two"), (1.0, 0.14, "one")):
        label = f"{name} standard deviation{'s' if times > 1.0 else ''} of noise"
        axes.axhspan(-times * noise, times * noise, color=GREEN, alpha=alpha, lw=0, zorder=0, label=label)
    axes.axhline(0.0, color=GREEN, lw=0.9, ls="--", zorder=1)


@styled
def plot_drift(time: Array, tared_once: Array, tared_again: Array, retare: float, walk: float) -> Figure:
    """What drift adds to a force in a long run, tared once and tared anew, with the random walk's own spread.

    What goes beyond the spread is the tare's own noise, which stays in every force until the next tare.
    Forces (n, 3) [N] over time (n,) [s]; ``retare``: time between tares [s]; ``walk``: rms drift after one
    second [N/sqrt(s)].
    """
    figure = new_figure(9.0, 4.6)
    once, again = figure.subplots(1, 2, sharey=True)
    total = time[-1] + time[0]
    moments = np.linspace(0.0, total, 1201)
    for axes, values, age, title in (
        (once, tared_once, moments, "tared once, at the start"),
        (again, tared_again, np.mod(moments, retare), f"tared every {retare:g} s, as between strokes"),
    ):
        spread = walk * np.sqrt(age)
        axes.fill_between(
            moments, -2.0 * spread, 2.0 * spread, color=GREY, alpha=0.18, lw=0, label="drift, 2 sigma"
        )
        for axis in range(3):
            look = {"color": AXIS_COLORS[axis], "ls": DASHES[axis], "label": f"{AXES[axis]}, 5 s mean"}
            axes.plot(time, values[:, axis], lw=1.0, **look)
        axes.set_xlabel("time [s]")
        small_title(axes, title)
    once.set_ylabel("force read while nothing touches [N]")
    facts = [
        f"{walk * np.sqrt(total):.2g} N rms after {total:.0f} s",
        f"{walk * np.sqrt(retare):.2g} N between tares",
    ]
    head(figure, f"Drift of the wrist sensor, {walk:g} N/sqrt(s)", facts, legend=(once,))
    return figure
