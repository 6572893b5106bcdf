"""Force along the path against curvature, as the paper's figure 15 shows it, and runs side by side (layer 8c)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polish_sim.analysis.peaks import FLAT_1_M, SHARP_1_M, curvature_peaks
from polish_sim.analysis.rows import fed, numbers
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, SERIES, head, new_figure, shade_band, styled
from polish_sim.planning.toolpath import ToolPath

Array = NDArray[np.float64]

BAND_N = 4.0
NUMBERED_PEAKS = 24
"""More curvature peaks than this are marked without their number."""


@styled
def plot_surface_force(record: RunRecord) -> Figure:
    """Draw the force along the path over the path's curvature, the strong bends marked in both.

    Args:
        record: A run of ``surface`` with its path.

    Returns:
        The figure.
    """
    figure = new_figure(10.0, 5.4)
    force, bend = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    target = record.scenario.process.contact_force_n
    _draw_force(force, record, BLUE, "exact contact force")
    if record.path is not None and record.path.force is not None:
        _draw_wanted(force, record.path, target)
    else:
        shade_band(force, target, BAND_N, f"{target:g} ± {BAND_N:g} N")
    force.set(ylabel="force along the tool axis [N]", ylim=_force_limits([record], target))
    if record.path is not None:
        _draw_curvature(bend, record.path)
        _mark_peaks((force, bend), record.path)
    force.legend(loc="lower right", ncols=3)
    bend.set(xlabel="along the path [m]", ylabel="curvature [1/m]")
    m = record.metrics
    facts = (
        f"in ±{BAND_N:g} N: {_percent(m.get('force_within_4n'))}",
        f"rms {_newton(m.get('force_rms_error_n'))}",
        f"{m.get('curvature_peaks', 0)} curvature peaks: error there {_newton(m.get('force_error_at_peaks_n'))}, "
        f"median {_newton(m.get('force_error_median_n'))}",
    )
    head(figure, force, f"Force along the path, {record.scenario.controller.name}", facts)
    return figure


@styled
def plot_surface_runs(records: Sequence[RunRecord]) -> Figure:
    """Draw the force of several runs along the path, one below the other, each with its distribution beside it.

    Args:
        records: Runs of ``surface``, e.g. with and without force control.

    Returns:
        The figure.
    """
    figure = new_figure(10.0, 1.2 + 2.1 * len(records))
    grid = figure.subplots(len(records), 2, sharex="col", sharey=True, width_ratios=(4.0, 1.0), squeeze=False)
    target = records[0].scenario.process.contact_force_n
    low, high = _force_limits(records, target)
    for index, (record, (along, share)) in enumerate(zip(records, grid, strict=True)):
        color = SERIES[index % len(SERIES)]
        _draw_force(along, record, color, None)
        shade_band(along, target, BAND_N, "")
        along.set(ylabel="force [N]", ylim=(low, high))
        along.set_title(f"{record.scenario.controller.name} ({record.name})", fontsize=9.0, color=color)
        _, force = process_force(record)
        share.hist(force, bins=np.linspace(low, high, 60), orientation="horizontal", color=color, density=True)
        shade_band(share, target, BAND_N, "")
        share.set_title(f"in ±{BAND_N:g} N: {_percent(record.metrics.get('force_within_4n'))}", fontsize=9.0)
        share.grid(visible=False)
        share.set_xticks([])
    grid[-1, 0].set(xlabel="along the path [m]")
    grid[-1, 1].set(xlabel="share of the time")
    figure.suptitle("Force along the path, side by side", x=0.01, ha="left", fontsize=11.5, fontweight="bold")
    return figure


def process_force(record: RunRecord) -> tuple[Array, Array]:
    """Place on the path [m] and exact force [N] of the logged rows of the process, each shape (n,)."""
    process = fed(record.log)
    return numbers(record.log, "path_s_m")[process], numbers(record.log, "normal_force_n")[process]


def _draw_force(axes: Axes, record: RunRecord, color: str, label: str | None) -> None:
    process = fed(record.log)
    place, force = process_force(record)
    low, high = numbers(record.log, "normal_force_min_n")[process], numbers(record.log, "normal_force_max_n")[process]
    axes.fill_between(place, low, high, color=color, alpha=0.25, lw=0)
    axes.plot(place, force, color=color, lw=0.7, label=label)


def _draw_wanted(axes: Axes, path: ToolPath, usual: float) -> None:
    """The force the path asks for, and the band around it."""
    s = path.s[path.process]
    wanted = path.force_at(s, usual)
    axes.fill_between(s, wanted - BAND_N, wanted + BAND_N, color=GREEN, alpha=0.13, lw=0, zorder=0)
    axes.plot(s, wanted, color=GREEN, lw=1.2, ls="--", label=f"force of the path ± {BAND_N:g} N")


def _draw_curvature(axes: Axes, path: ToolPath) -> None:
    process = path.process
    axes.plot(path.s[process], path.curvature[process], color=GREY, lw=0.9)
    low, high = axes.get_ylim()
    for level, color, style in ((SHARP_1_M, ORANGE, "--"), (FLAT_1_M, GREY, ":")):
        for line in (-level, level):
            if low <= line <= high:
                axes.axhline(line, color=color, lw=0.8, ls=style)
                axes.annotate(
                    f" {1e3 / line:.0f} mm", (1.0, line), xycoords=("axes fraction", "data"), color=color, va="center"
                )


def _mark_peaks(panels: Sequence[Axes], path: ToolPath) -> None:
    """Mark each peak on the curvature and draw its place through the other panels, when there are few enough."""
    force, bend = panels
    peaks = curvature_peaks(path)
    bend.plot(path.s[peaks], path.curvature[peaks], "v", color=ORANGE, ms=5)
    few = len(peaks) <= NUMBERED_PEAKS
    for number, place in enumerate(path.s[peaks], 1):
        force.axvline(place, color=ORANGE, lw=0.9, alpha=0.7 if few else 0.25, zorder=0)
        if few:
            force.text(
                place, 1.0, str(number), transform=force.get_xaxis_transform(), color=ORANGE, ha="center", va="top"
            )


def _force_limits(records: Sequence[RunRecord], target: float) -> tuple[float, float]:
    forces = np.concatenate([process_force(record)[1] for record in records])
    low = min(target - 1.6 * BAND_N, float(forces.min(initial=target)) - 1.0)
    return max(low, -2.0), max(target + 1.6 * BAND_N, float(forces.max(initial=target)) + 1.0)


def _percent(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else f"{100.0 * value:.1f}%"


def _newton(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:.2f} N"
