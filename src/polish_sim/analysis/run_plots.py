"""Pictures of arc and force runs, alone and side by side, and of the figures of many seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polish_sim.analysis.claim import HOLD_BAND_N, Claim, bound_text, figure_of, value_text
from polish_sim.analysis.metrics import (
    distance_to_arc,
    first_contact,
    moving_average,
    steady_feed,
)
from polish_sim.analysis.run_record import Records, RunRecord, stop_mark
from polish_sim.analysis.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    SERIES,
    facts_of,
    head,
    limit_line,
    line_look,
    mark_stop,
    new_figure,
    shade_band,
    styled,
)
from polish_sim.arrays import Array, Bools
from polish_sim.log import RETRACT_PHASE, RunLog

PAPER_LIMIT_M = 3e-4


@styled
def plot_arc(record: RunRecord) -> Figure:
    """Draw the speed and the distance from the commanded circle over time."""
    figure = new_figure(9.0, 5.0)
    speed, error = figure.subplots(2, 1, sharex=True)
    process = record.log.fed
    time, positions = record.fed("time_s"), record.fed("tcp_position_m")
    start = time[0] if len(time) else 0.0

    _draw_speed(speed, time - start, record)
    counted = steady_feed(process, record.log["time_s"], record.log["path_s_m"])[process]
    _draw_error(error, time - start, distance_to_arc(positions), counted)
    stop = stop_mark(record.metrics)
    if stop and len(time):
        mark_stop((speed, error), stop.time - start)
    facts = facts_of(
        record.metrics,
        ("error max {:.3g} mm", "tracking_error_max_m", 1e3),
        ("error rms {:.3g} mm", "tracking_error_rms_m", 1e3),
        ("speed {:.3g} mm/s", "speed_mean_m_s", 1e3),
        ("off by at most {:.3g} mm/s", "speed_max_deviation_m_s", 1e3),
    )
    head(figure, f"Circle at constant feed, {record.scenario.controller.label}", facts, legend=(speed, error))
    return figure


def plot_arc_runs(records: Records) -> Figure:
    """Draw the tracking error of several runs over the way round the commanded circle."""

    def curve(record: RunRecord) -> tuple[Array, Array]:
        return record.fed("path_s_m"), distance_to_arc(record.fed("tcp_position_m")) * 1e6

    return compare_runs(
        records,
        curve,
        ("at most {:.3g} mm", "tracking_error_max_m", 1e3),
        (PAPER_LIMIT_M * 1e6, "paper: < 0.3 mm"),
        ("way round the circle [m]", "distance from the circle [µm]"),
        "Distance from the circle, side by side",
    )


@styled
def compare_runs(
    records: Records,
    curve: Callable[[RunRecord], tuple[Array, Array]],
    fact: tuple[str, str, float],
    limit: tuple[float, str],
    labels: tuple[str, str],
    title: str,
) -> Figure:
    """Draw an error of several runs over each other, a line each with its controller and a figure, and a
    limit."""
    figure = new_figure(9.0, 4.6)
    axes = figure.add_subplot()
    for index, record in enumerate(records):
        label = ", ".join(
            [f"{record.name}: {record.scenario.controller.label}", *facts_of(record.metrics, fact)]
        )
        axes.plot(*curve(record), label=label, **line_look(index))
    limit_line(axes, *limit)
    axes.set(xlabel=labels[0], ylabel=labels[1], ylim=(0.0, None))
    head(figure, title, legend=(axes,))
    return figure


def _draw_speed(axes: Axes, time: Array, record: RunRecord) -> None:
    feed = record.scenario.process.feed_m_s * 1e3
    value = record.fed("tcp_speed_m_s") * 1e3
    smooth = moving_average(time, value, 0.05)
    offset = len(value) - len(smooth)
    axes.plot(time, value, color=GREY, lw=0.5, alpha=0.5, label="every sample")
    if len(smooth):
        axes.plot(time[offset // 2 : offset // 2 + len(smooth)], smooth, color=BLUE, label="50 ms average")
    shade_band(axes, feed, 0.01 * feed, "feed ±1%")
    axes.set(ylabel="tool speed [mm/s]", ylim=(0.9 * feed, 1.1 * feed))


def _draw_error(axes: Axes, time: Array, distance: Array, counted: Bools) -> None:
    axes.plot(time, distance * 1e6, color=GREY, lw=0.8, label="ramps, not counted")
    axes.plot(time[counted], distance[counted] * 1e6, color=BLUE, label="distance" if counted.any() else None)
    limit_line(axes, PAPER_LIMIT_M * 1e6, "paper: < 0.3 mm")
    axes.set(xlabel="time since the start of the feed [s]", ylabel="distance from the circle [µm]")
    axes.set_ylim(0.0, 1.1e6 * max(distance.max(initial=0.0), PAPER_LIMIT_M))


_BEFORE_S, _LONGEST_S = 0.5, 6.0


@styled
def plot_force(record: RunRecord) -> Figure:
    """Draw exact and measured force from just before first contact, the ±3 N band, and where the force
    settles."""
    figure = new_figure(9.0, 4.8)
    axes = figure.add_subplot()
    target = record.scenario.process.contact_force_n
    held, origin = _before_retract(record.log)
    time, force = response(record)
    measured = record.log["wrench_measured_tool"][held, 2]
    touched = first_contact(force) is not None
    shade_band(axes, target, HOLD_BAND_N, f"{target:g} ± {HOLD_BAND_N:g} N, the paper's band")
    axes.plot(time, measured, color=GREY, lw=0.6, alpha=0.8, label="as the controller measures it")
    axes.plot(time, force, color=BLUE, lw=1.5, label="exact contact force")
    if touched:
        axes.axvline(0.0, color=ORANGE, lw=1.0, ls="-.", label="first contact")
        settling = figure_of(record.metrics, "settling_time_3n_s")
        if not math.isnan(settling):
            label = f"inside ±{HOLD_BAND_N:g} N from {settling:.3f} s on"
            axes.axvline(settling, color=BLUE, lw=1.2, ls=":", label=label)
    _frame(axes, time, [force, measured], target, touched)
    stop = stop_mark(record.metrics)
    if stop and stop.time - origin <= _LONGEST_S:
        mark_stop((axes,), stop.time - origin)
    head(
        figure,
        f"Force from first contact, {record.scenario.controller.label}",
        _facts(record, touched),
        legend=(axes,),
    )
    return figure


@styled
def plot_force_runs(records: Records) -> Figure:
    """Draw the force of several runs over each other; of many seeds the one that overshoots most in
    orange."""
    figure = new_figure(9.0, 4.8)
    axes = figure.add_subplot()
    targets = sorted({record.scenario.process.contact_force_n for record in records})
    for target in targets:
        shade_band(axes, target, HOLD_BAND_N, f"{target:g} ± {HOLD_BAND_N:g} N, the paper's band")
    responses = [response(record) for record in records]
    few = len({replace(record.scenario, seed=0) for record in records}) > 1 and len(records) <= len(SERIES)
    for index, (record, (time, force)) in enumerate(zip(records, responses, strict=True)):
        label = (
            f"{record.name}: {record.scenario.controller.label}, "
            f"{record.scenario.process.contact_force_n:g} N"
        )
        look = line_look(index) | {"label": label} if few else {"color": GREY, "lw": 0.6, "alpha": 0.7}
        axes.plot(time, force, **look)
    if not few:
        axes.lines[-1].set_label("every seed")
        worst = int(np.argmax(_or_zero(records, "overshoot_n")))
        label = f"seed {records[worst].scenario.seed}, overshoots most"
        axes.plot(*responses[worst], color=ORANGE, lw=1.6, label=label)
    axes.axvline(0.0, color=GREY, lw=1.0, ls="-.", label="first contact")
    longest = max((time for time, _ in responses), key=lambda time: time[-1])
    _frame(axes, longest, [force for _, force in responses], targets[-1], touched=True)
    figures = ("settling_time_3n_s", "overshoot_n")
    largest = {name: _or_zero(records, name).max() for name in figures}
    facts = facts_of(
        largest,
        ("slowest settling to ±3 N {:.3f} s", figures[0], 1.0),
        ("overshoot {:.1f} N", figures[1], 1.0),
    )
    head(figure, "Force from first contact", [f"{len(records)} runs", *facts], legend=(axes,))
    return figure


def response(record: RunRecord) -> tuple[Array, Array]:
    """Time since first contact, without one since the start [s], force [N], up to the retract, each shape
    (n,)."""
    held, origin = _before_retract(record.log)
    return record.log["time_s"][held] - origin, record.log["normal_force_n"][held]


def _before_retract(log: RunLog) -> tuple[Bools, float]:
    """The rows before the retract, (n,), all where a run stops at its very start; and when first contact is,
    without one the start [s]."""
    held = log["phase"] < RETRACT_PHASE
    held |= not held.any()
    contact = first_contact(log["normal_force_n"][held])
    return held, log["time_s"][held][contact or 0]


def _frame(axes: Axes, time: Array, forces: Sequence[Array], target: float, touched: bool) -> None:
    highest = max(force.max(initial=0.0) for force in forces)
    lowest = min(force.min(initial=0.0) for force in forces)
    axes.set(
        xlabel=f"time since {'first contact' if touched else 'the start'} [s]",
        ylabel="force along the tool axis [N]",
        # A log may be one row.
        xlim=(max(time[0], -_BEFORE_S), min(time[-1] + 0.01, _LONGEST_S)),
        ylim=(max(lowest, -target) - 1.0, max(target + 2.5 * HOLD_BAND_N, highest + 1.0)),
    )


def _facts(record: RunRecord, touched: bool) -> list[str]:
    if not touched:
        return ["the pad never touched the part"]
    return facts_of(
        record.metrics,
        ("settling to ±3 N {:.3f} s", "settling_time_3n_s", 1.0),
        ("to ±1 N {:.3f} s", "settling_time_1n_s", 1.0),
        ("overshoot {:.1f} N", "overshoot_n", 1.0),
        ("in ±3 N after 0.5 s: {:.4g}%", "steady_within_3n", 100.0),
    )


def _or_zero(records: Records, figure: str) -> Array:
    return np.nan_to_num([figure_of(record.metrics, figure) for record in records])


SAME = 1e-3  #: Relative spread up to which a figure counts as the same in all seeds


# The figures of many seeds: a row for each that differs, its extreme seeds named.


@styled
def plot_seeds(records: Records, claims: Sequence[Claim]) -> Figure:
    """Draw every figure of an experiment that differs between seeds on a line of its own, the worst seed
    named.

    Those that are the same in all seeds stand in the head.
    """
    values = {
        claim: np.array([figure_of(record.metrics, claim.figure) for record in records]) for claim in claims
    }
    known = [claim for claim in claims if np.isfinite(values[claim]).any()]
    drawn = [claim for claim in known if not np.ptp(values[claim]) <= SAME * np.abs(values[claim]).max()]
    figure = new_figure(9.0, 1.2 + 0.72 * max(len(drawn), 1))
    panels = figure.subplots(max(len(drawn), 1), 1, squeeze=False)[:, 0]
    seeds = [record.scenario.seed for record in records]
    for axes, claim in zip(panels, drawn, strict=False):
        _draw_claim(axes, claim, seeds, values[claim])
    panels[0].set_visible(bool(drawn))
    same = [
        f"{c.label.strip()} {value_text(c, values[c][0])} {c.unit}".strip() for c in known if c not in drawn
    ]
    same[:1] = [f"the same in all seeds: {text}" for text in same[:1]]
    head(
        figure,
        f"{records[0].scenario.experiment}, {records[0].scenario.controller.label}: {len(records)} seeds",
        same,
    )
    return figure


def _draw_claim(axes: Axes, claim: Claim, seeds: Sequence[int], values: Array) -> None:
    """One figure of all seeds on a line, what is asked of it, and its worst seed by number."""
    met = np.array([claim.met_by(value) for value in values])
    limits = [claim.scale * limit for limit in (claim.low, claim.high) if math.isfinite(limit)]
    drawn = claim.scale * values
    for rows, mark, color in ((met, "o", BLUE), (~met, "X", ORANGE)):
        if rows.any():  # a line of no points that is not clipped breaks the layout
            axes.plot(drawn[rows], 0.0 * drawn[rows], mark, color=color, ms=6, alpha=0.7, clip_on=False)
    if not claim.is_mean:
        worst = int(np.nanargmin(values) if claim.more_is_better else np.nanargmax(values))
        name = f"seed {seeds[worst]}: {value_text(claim, values[worst])}"
        axes.annotate(
            name, (drawn[worst], 0.0), (0, 6), textcoords="offset points", ha="center", fontsize=8.0
        )
    for limit in limits:
        axes.axvline(limit, color=GREEN, ls="--", lw=1.4)
    asked = f", asked {bound_text(claim)}: {met.sum()} of {len(seeds)}" if claim.bounded else ""
    axes.set_title(f"{claim.label.strip()} [{claim.unit or '-'}]{asked}")
    # From a spread of 10% on to scale: a smaller one looks small.
    shown = np.array([np.nanmin(drawn), np.nanmax(drawn), *limits])
    room = 0.12 * max(np.ptp(shown), 0.1 * np.abs(shown).max())
    most = 100.0 if claim.unit == "%" and shown.max() <= 100.0 else math.inf
    axes.set_xlim(shown.min() - room, min(shown.max() + room, most))
    axes.ticklabel_format(axis="x", useOffset=False)
    axes.set(ylim=(-1.0, 2.2), yticks=[])
    axes.spines["left"].set_visible(False)
