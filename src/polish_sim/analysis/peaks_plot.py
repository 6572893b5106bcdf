"""What the force does where the path bends strongly: all bends laid over each other (paper 1, fig. 15; layer 8c)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polish_sim.analysis.peaks import WINDOW_M, curvature_peaks
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.style import BLUE, GREY, ORANGE, head, new_figure, styled
from polish_sim.analysis.surface_plot import process_force

Array = NDArray[np.float64]

HALF_WIDTH_M = 0.04
_POINTS = 401


@styled
def plot_peaks(record: RunRecord) -> Figure:
    """Draw force error and curvature around every curvature peak, and their means over the peaks.

    Args:
        record: A run of ``surface`` with its path.

    Returns:
        The figure; without a peak on the way that was run, one that says so.
    """
    figure = new_figure(9.0, 5.2)
    force, bend = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
    offset = np.linspace(-HALF_WIDTH_M, HALF_WIDTH_M, _POINTS)
    errors, bends = around_peaks(record, offset)
    for rows, axes in ((errors, force), (bends, bend)):
        axes.plot(offset * 1e3, rows.T, color=GREY, lw=0.5, alpha=0.5)
        if len(rows):
            axes.plot(offset * 1e3, rows.mean(axis=0), color=BLUE, lw=2.0, label=f"mean of {len(rows)} peaks")
        axes.axvline(0.0, color=ORANGE, lw=0.9)
    force.set(ylabel="force - set force [N]")
    bend.set(xlabel="along the path, from the curvature peak [mm]", ylabel="curvature [1/m]")
    bend.set_xlim(1e3 * offset[0], 1e3 * offset[-1])
    if len(errors):
        force.legend(loc="upper left")
    else:
        force.set_yticks([])
        bend.set_yticks([])
    title = f"Force where the path bends strongly, {record.scenario.controller.label}"
    head(figure, force, title, _facts(record, errors))
    return figure


def _facts(record: RunRecord, errors: Array) -> list[str]:
    """The largest of the mean, and beside it the figure of the table, which is of all peaks that were passed."""
    if not len(errors):
        return ["no bend with its surroundings on the way"]
    facts = [f"largest of the mean {np.abs(errors.mean(axis=0)).max():.2f} N"]
    own, count = record.metrics.get("force_error_at_peaks_n"), record.metrics.get("curvature_peaks", 0)
    if own is not None:
        facts.append(f"largest within {1e3 * WINDOW_M:.0f} mm of each: {own:.2f} N, mean of {count}")
    if count > len(errors):
        facts.append(f"{count - len(errors)} less than {1e3 * HALF_WIDTH_M:.0f} mm from an end, not drawn")
    return facts


def around_peaks(record: RunRecord, offset: Array) -> tuple[Array, Array]:
    """Force error [N] and curvature [1/m] around the peaks whose surroundings were run.

    Args:
        record: The run.
        offset: Places relative to a peak [m], shape (k,).

    Returns:
        Both of shape (peaks, k).
    """
    place, force = process_force(record)
    if record.path is None or len(place) == 0:
        return np.empty((0, len(offset))), np.empty((0, len(offset)))
    peaks = record.path.s[curvature_peaks(record.path)]
    whole = peaks[(peaks + offset[0] >= place[0]) & (peaks + offset[-1] <= place[-1])]
    at = whole[:, None] + offset
    error = force - record.path.force_at(place, record.scenario.process.contact_force_n)
    return np.interp(at, place, error), np.interp(at, record.path.s, record.path.curvature)
