"""Torques of a motion that was not fitted: measured, predicted, and as the drawing has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from polish_sim.analysis.style import BLUE, GREY, ORANGE, SERIES, head, new_figure, styled
from polish_sim.arrays import Array


class TorqueData(NamedTuple):
    """Torques over time [N m], shape (m, n) each; rows that do not count are left out."""

    time: Array  #: [s], shape (m,)
    measured: Array
    predicted: Array
    drawing: Array
    error: Array  #: Rms error of the prediction / range of the torque, shape (n,)


@styled
def plot_torques(data: TorqueData, title: str, facts: Sequence[str]) -> Figure:
    """Joint by joint: the measured torque, the identified model's, the drawing's (paper's fig. 4)."""
    n = data.measured.shape[1]
    figure = new_figure(11.0, 1.1 + 2.2 * ((n + 1) // 2))
    grid = figure.subplots((n + 1) // 2, 2, sharex=True, squeeze=False).ravel()
    time = _broken(data.time, data.time)
    for joint, axes in enumerate(grid[:n]):
        for values, colour, width, label in (
            (data.measured, GREY, 0.5, "measured"),
            (data.drawing, ORANGE, 1.0, "drawing"),
            (data.predicted, BLUE, 1.2, "identified"),
        ):
            axes.plot(time, _broken(values[:, joint], data.time), color=colour, lw=width, label=label)
        axes.set_ylabel(f"joint {joint + 1} [N m]\nerror {100 * data.error[joint]:.3f}%")
    for axes in grid[-2:]:
        axes.set_xlabel("time [s]; gaps: a joint reverses")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
    head(figure, grid[0], title, facts)
    return figure


class MotionData(NamedTuple):
    """One period of an exciting motion: times (m,) [s], positions [rad] and speeds [rad/s], shape (m, n)."""

    time: Array
    q: Array
    qd: Array


@styled
def plot_motion(data: MotionData, title: str, facts: Sequence[str]) -> Figure:
    """Positions and speeds of all joints over a period."""
    figure = new_figure(9.0, 5.0)
    above, below = figure.subplots(2, 1, sharex=True)
    for joint in range(data.q.shape[1]):
        above.plot(data.time, np.degrees(data.q[:, joint]), color=SERIES[joint % 6], label=f"{joint + 1}")
        below.plot(data.time, np.degrees(data.qd[:, joint]), color=SERIES[joint % 6])
    above.set_ylabel("joint position [deg]")
    below.set_ylabel("joint speed [deg/s]")
    below.set_xlabel("time [s]")
    figure.legend(*above.get_legend_handles_labels(), loc="outside upper right", ncols=6, title="joint")
    head(figure, above, title, facts)
    return figure


def _broken(values: Array, time: Array) -> Array:
    """The values with an empty place wherever time jumps, so that no line is drawn across."""
    jumps = np.flatnonzero(np.diff(time) > 1.5 * np.median(np.diff(time))) + 1
    return np.insert(values.astype(float), jumps, np.nan)
