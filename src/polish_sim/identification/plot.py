"""Torques of a motion that was not fitted: measured, predicted, and as the drawing has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from polish_sim.analysis.style import BLUE, DASHES, GREY, ORANGE, head, line_look, new_figure, styled
from polish_sim.arrays import Array
from polish_sim.identification.fourier import FourierMotion

if TYPE_CHECKING:
    from polish_sim.identification.identify import Identification


@styled
def plot_torques(found: Identification, title: str, facts: Sequence[str]) -> Figure:
    """Torques held out, joint by joint: measured, the identified model's, the drawing's (paper's fig. 4)."""
    held, Y = found.held_out, found.model.regressor(found.held_out.states)
    drawing, predicted = Y @ found.drawing.parameters, Y[:, :, found.base.columns] @ found.found.theta
    n = held.measured.shape[1]
    figure = new_figure(11.0, 1.1 + 2.2 * ((n + 1) // 2))
    grid = figure.subplots((n + 1) // 2, 2, sharex=True, squeeze=False).ravel()
    time = _broken(held.time, held.time)
    for joint, axes in enumerate(grid[:n]):
        for values, colour, dashes, width, label in (
            (held.measured, GREY, "-", 0.5, "measured"),
            (drawing, ORANGE, DASHES[1], 1.0, "drawing"),
            (predicted, BLUE, "-", 1.2, "identified"),
        ):
            line = _broken(values[:, joint], held.time)
            axes.plot(time, line, color=colour, ls=dashes, lw=width, label=label)
        axes.set_ylabel(f"joint {joint + 1} [N m]\nerror {100 * found.figures['nrms_heldout'][joint]:.3f}%")
    for axes in grid[-2:]:
        axes.set_xlabel("time [s]; gaps: a joint reverses")
    head(figure, title, facts, legend=(grid[0],))
    return figure


@styled
def plot_motion(motion: FourierMotion, title: str, facts: Sequence[str]) -> Figure:
    """Positions and speeds of all joints over a period of an exciting motion."""
    figure = new_figure(9.0, 5.0)
    above, below = figure.subplots(2, 1, sharex=True)
    time = np.linspace(0.0, motion.period, 1001)
    states = motion(time)
    for joint in range(states.q.shape[1]):
        above.plot(time, np.degrees(states.q[:, joint]), label=f"joint {joint + 1}", **line_look(joint))
        below.plot(time, np.degrees(states.qd[:, joint]), **line_look(joint))
    above.set_ylabel("joint position [deg]")
    below.set_ylabel("joint speed [deg/s]")
    below.set_xlabel("time [s]")
    head(figure, title, facts, legend=(above,))
    return figure


def _broken(values: Array, time: Array) -> Array:
    """The values with an empty place wherever time jumps, so that no line is drawn across."""
    jumps = np.flatnonzero(np.diff(time) > 1.5 * np.median(np.diff(time))) + 1
    return np.insert(values.astype(float), jumps, np.nan)
