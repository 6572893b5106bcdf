"""A payload's calibration as a picture: residuals reading by reading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polish_sim.analysis.style import (
    AXIS_COLORS,
    GREEN,
    GREY,
    MARKS,
    head,
    new_figure,
    styled,
)
from polish_sim.arrays import Array, Bools

AXES = "xyz"


@styled
def plot_residuals(residuals: Array, noise: Array, used: Bools, facts: Sequence[str]) -> Figure:
    """Residuals of force and torque, reading by reading, with bands of one and two noise deviations.

    Args:
        residuals: What is left of the readings after the fit [N, N m], shape (n, 6).
        noise: Standard deviation of one reading [N, N m], shape (6,).
        used: Which readings the fit rests on, shape (n,).
        facts: Figures for the head.
    """
    figure = new_figure(9.0, 6.0)
    panels = figure.subplots(2, 1, sharex=True)
    number = np.arange(1, len(used) + 1)
    groups = ((slice(0, 3), 1.0, "force residual [N]"), (slice(3, 6), 1e3, "torque residual [mN m]"))
    for axes, (rows, scale, label) in zip(panels, groups, strict=True):
        values = residuals[:, rows] * scale
        deviation = noise[rows][0] * scale
        _noise_band(axes, deviation)
        for axis in range(3):
            look = {"color": AXIS_COLORS[axis], "marker": MARKS[axis], "label": AXES[axis]}
            axes.plot(number, values[:, axis], ms=4, lw=0.9, **look)
        for k in number[~used]:
            axes.axvspan(k - 0.45, k + 0.45, color=GREY, alpha=0.35, lw=0)
        axes.set_ylabel(label)
        # An outlier would flatten everything else.
        reach = max(4.0 * deviation, 1.1 * np.abs(values[used]).max(initial=0.0), 1e-9)
        axes.set_ylim(-reach, reach)
    panels[1].set_xlabel("reading; a slope would be drift")
    head(figure, "Calibration of the payload", facts, legend=panels[1:])
    return figure


def _noise_band(axes: Axes, noise: float) -> None:
    for times, alpha, name in ((2.0, 0.10, "two"), (1.0, 0.14, "one")):
        label = f"{name} standard deviation{'s' if times > 1.0 else ''} of noise"
        axes.axhspan(-times * noise, times * noise, color=GREEN, alpha=alpha, lw=0, zorder=0, label=label)
    axes.axhline(0.0, color=GREEN, lw=0.9, ls="--", zorder=1)
