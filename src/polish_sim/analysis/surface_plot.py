"""Force along the path against curvature, as the paper's figure 15 shows it, and runs side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polish_sim.analysis.claim import FOLLOW_BAND_N, figure_of
from polish_sim.analysis.metrics import (
    FLAT_1_M,
    SHARP_1_M,
    WINDOW_M,
    curvature_peaks,
)
from polish_sim.analysis.run_plots import plot_force
from polish_sim.analysis.run_record import WHOLE, Records, RunRecord, ending, stop_mark
from polish_sim.analysis.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    SERIES,
    facts_of,
    head,
    mark_stop,
    new_figure,
    shade_band,
    styled,
)
from polish_sim.errors import count_text
from polish_sim.planning.toolpath import ToolPath
from polish_sim.row_file import Metrics

NUMBERED_PEAKS = 24  #: More curvature peaks than this are marked without their number


@styled
def plot_surface_force(record: RunRecord) -> Figure:
    """Draw the force along the path over the path's curvature, the strong bends marked in both.

    A run that stopped before the feed is drawn as force over time instead.
    """
    if not record.log.fed.any():
        return plot_force(record)
    figure = new_figure(10.0, 5.6)
    force, bend = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    _draw_force(force, record, BLUE, "exact contact force")
    _draw_wanted(force, record, labelled=True)
    below, above = _error_limits([record])
    limits = max(_set_force(record) + below, -2.0), _set_force(record) + above
    force.set(ylabel="force along the tool axis [N]", ylim=limits)
    if record.path:
        _draw_curvature(bend, record.path)
        _mark_peaks((force, bend), record.path)
    bend.set(xlabel="along the path [m]", ylabel="curvature [1/m]")
    stop = stop_mark(record.metrics)
    m = record.metrics
    if stop:
        mark_stop((force, bend), stop.s)
    facts = facts_of(
        m,
        (f"in ±{FOLLOW_BAND_N:g} N: {{:.4g}}%", "force_within_4n", 100.0),
        ("error rms {:.2f} N", "force_rms_error_n", 1.0),
        ("median {:.2f} N", "force_error_median_n", 1.0),
        ("largest {:.2f} N", "force_max_deviation_n", 1.0),
        *([("{:.1f}% of the path", "path_done", 100.0)] if stop else []),
    )
    head(
        figure,
        f"Force along the path, {record.scenario.controller.label}",
        [*facts, _at_peaks(m)],
        legend=(force, bend),
    )
    return figure


@styled
def plot_surface_runs(records: Records) -> Figure:
    """Draw the force of several runs along the path, one below the other, each with its distribution beside
    it."""
    figure = new_figure(10.0, 1.2 + 2.1 * len(records))
    grid = figure.subplots(
        len(records), 2, sharex="col", sharey="row", width_ratios=(4.0, 1.0), squeeze=False
    )
    below, above = _error_limits(records)
    for index, (record, (along, share)) in enumerate(zip(records, grid, strict=True)):
        color = SERIES[index % len(SERIES)]
        target = _set_force(record)
        # Every run about its own set force, all on one scale.
        low, high = max(target + below, -2.0), target + above
        _draw_force(along, record, color, None)
        _draw_wanted(along, record, labelled=False)
        along.set(ylabel="force [N]", ylim=(low, high))
        along.set_title(_title(record), color=color)
        force, bins = record.fed("normal_force_n"), np.linspace(low, high, 60)
        share.hist(force, bins=bins, orientation="horizontal", color=color, density=True)
        shade_band(share, target, FOLLOW_BAND_N, "")
        within = facts_of(record.metrics, (f"in ±{FOLLOW_BAND_N:g} N: {{:.4g}}%", "force_within_4n", 100.0))
        share.set_title("".join(within))
        share.grid(visible=False)
        share.set_xticks([])
    grid[-1, 0].set(xlabel="along the path [m]")
    grid[-1, 1].set(xlabel="share of the time")
    head(
        figure,
        "Force along the path, side by side",
        [f"shaded: set force ± {FOLLOW_BAND_N:g} N, the paper's band"],
    )
    return figure


def _draw_force(axes: Axes, record: RunRecord, color: str, label: str | None) -> None:
    place = record.while_fed("path_s_m")
    low, high = (record.while_fed(f"normal_force_{end}_n") for end in ("min", "max"))
    axes.fill_between(place, low, high, color=color, alpha=0.25, lw=0)
    axes.plot(place, record.while_fed("normal_force_n"), color=color, lw=0.7, label=label)


def _set_force(record: RunRecord) -> float:
    return record.scenario.process.contact_force_n


def _draw_wanted(axes: Axes, record: RunRecord, labelled: bool) -> None:
    """The force asked for, of the path where that names one, and the band around it."""
    band = f"± {FOLLOW_BAND_N:g} N, the paper's band"
    if record.path is None or record.path.force is None:
        shade_band(
            axes, _set_force(record), FOLLOW_BAND_N, f"{_set_force(record):g} {band}" if labelled else ""
        )
        return
    s = record.path.s
    wanted = np.where(record.path.process, record.path.force_at(s, _set_force(record)), np.nan)
    axes.fill_between(
        s, wanted - FOLLOW_BAND_N, wanted + FOLLOW_BAND_N, color=GREEN, alpha=0.13, lw=0, zorder=0
    )
    axes.plot(
        s, wanted, color=GREEN, lw=1.2, ls="--", label=f"force of the path {band}" if labelled else None
    )


def _draw_curvature(axes: Axes, path: ToolPath) -> None:
    curvature = np.where(path.process, path.curvature, np.nan)
    axes.plot(path.s, curvature, color=GREY, lw=0.9, label="curvature of the path")
    # From flat on, so that the fit's noise on a plane, a sphere or a cylinder stays as small as it is.
    low, high = min(axes.get_ylim()[0], -FLAT_1_M), max(axes.get_ylim()[1], FLAT_1_M)
    axes.set_ylim(1.2 * low, 1.2 * high)
    for level, color, style in ((SHARP_1_M, ORANGE, "--"), (FLAT_1_M, GREY, ":")):
        for line in (-level, level):
            if low <= line <= high:
                axes.axhline(line, color=color, lw=0.8, ls=style)
                axes.annotate(
                    f" R {1e3 / line:.0f} mm",
                    (1.0, line),
                    xycoords=("axes fraction", "data"),
                    color=color,
                    va="center",
                )


def _mark_peaks(panels: Sequence[Axes], path: ToolPath) -> None:
    """Mark each peak on the curvature and draw its place through the other panels, when there are few
    enough."""
    force, bend = panels
    peaks = curvature_peaks(path)
    if len(peaks):
        bend.plot(path.s[peaks], path.curvature[peaks], "v", color=ORANGE, ms=5, label="strong bend")
    few = len(peaks) <= NUMBERED_PEAKS
    for number, place in enumerate(path.s[peaks], 1):
        force.axvline(place, color=ORANGE, lw=0.9, alpha=0.7 if few else 0.25, zorder=0)
        if few:
            force.text(
                place,
                0.99,
                f" {number}",
                transform=force.get_xaxis_transform(),
                color=ORANGE,
                va="top",
                clip_on=True,
            )


def _error_limits(records: Records) -> tuple[float, float]:
    """How far below and above its set force any of the runs is to be shown [N]."""
    offsets = np.concatenate([record.fed("normal_force_n") - _set_force(record) for record in records])
    below = min(-1.6 * FOLLOW_BAND_N, offsets.min(initial=0.0) - 1.0)
    return below, max(1.6 * FOLLOW_BAND_N, offsets.max(initial=0.0) + 1.0)


def _title(record: RunRecord) -> str:
    """Who ran, and what was asked; how it ended if it is not whole."""
    label = record.scenario.controller.label
    end = ending(record)
    name = label if record.name == label else f"{label} ({record.name})"
    asked = f"{_set_force(record):g} N at {1e3 * record.scenario.process.feed_m_s:g} mm/s"
    return f"{name}, {asked}{'' if end == WHOLE else f', {end}'}"


def _at_peaks(m: Metrics) -> str:
    count = figure_of(m, "curvature_peaks")
    if not count > 0:
        return "no curvature peak on the way" if count == 0 else ""
    peaks = count_text(int(count), "curvature peak")
    text = f"{peaks}: largest error within {1e3 * WINDOW_M:.0f} mm {{:.2f}} N on average"
    return "".join(facts_of(m, (text, "force_error_at_peaks_n", 1.0)))
