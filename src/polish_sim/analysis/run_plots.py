"""Pictures of arc and force runs, alone and side by side, and of the figures of many seeds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from polish_sim.analysis.claim import Claim, bound_text
from polish_sim.analysis.metrics import (
    PAPER_ARC,
    Circle,
    before_retract,
    distance_to_circle,
    fed,
    first_contact,
    moving_average,
    numbers,
    steady_feed,
)
from polish_sim.analysis.run_record import RunRecord, stop_mark
from polish_sim.analysis.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    SERIES,
    head,
    heading,
    mark_stop,
    new_figure,
    shade_band,
    styled,
)
from polish_sim.arrays import Array, Bools
from polish_sim.log import RunLog

PAPER_LIMIT_M = 3e-4
SHOWN_SHARE = 0.15  #: In the view of its plane, most share of the radius the largest distance is drawn at


@styled
def plot_arc(record: RunRecord, circle: Circle = PAPER_ARC) -> Figure:
    """Draw speed, tracking error and the tool point's way round the commanded circle."""
    figure = new_figure(10.0, 5.0)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.5, 1.0))
    speed, error = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    process = fed(record.log)
    time = numbers(record.log, "time_s")[process]
    positions = numbers(record.log, "tcp_position_m")[process]
    start = time[0] if len(time) else 0.0

    _draw_speed(speed, time - start, record)
    counted = steady_feed(process, numbers(record.log, "time_s"), numbers(record.log, "path_s_m"))[process]
    _draw_error(error, time - start, distance_to_circle(positions, circle), counted)
    speed.sharex(error)
    speed.tick_params(labelbottom=False)
    plane = figure.add_subplot(grid[:, 1])
    _draw_plane(plane, positions, circle)
    stop = stop_mark(record.metrics)
    if stop and len(time):
        mark_stop((speed, error), stop.time - start)
        x, y = (np.asarray(values)[-1:] for values in plane.lines[1].get_data())
        plane.plot(x, y, "X", color=RED, ms=8)

    m = record.metrics
    facts = (
        f"error max {_mm(m, 'tracking_error_max_m')} mm, rms {_mm(m, 'tracking_error_rms_m')} mm",
        f"speed {_mm(m, 'speed_mean_m_s')} ± {_mm(m, 'speed_max_deviation_m_s')} mm/s",
    )
    head(figure, speed, f"Circle at constant feed, {record.scenario.controller.label}", facts)
    return figure


@styled
def plot_arc_runs(records: Sequence[RunRecord], circle: Circle = PAPER_ARC) -> Figure:
    """Draw the tracking error of several runs over the way round the commanded circle."""
    figure = new_figure(9.0, 4.6)
    axes = figure.add_subplot()
    for index, record in enumerate(records):
        process = fed(record.log)
        error = distance_to_circle(numbers(record.log, "tcp_position_m")[process], circle)
        label = f"{record.name}: {record.scenario.controller.label}"
        axes.plot(numbers(record.log, "path_s_m")[process], error * 1e6, color=SERIES[index % len(SERIES)], label=label)
    axes.set(xlabel="way round the circle [m]", ylabel="distance from the circle [µm]", ylim=(0.0, None))
    axes.legend(loc="upper right")
    largest = [f"{record.name}: {_mm(record.metrics, 'tracking_error_max_m')} mm" for record in records]
    head(figure, axes, "Distance from the circle, side by side", largest)
    return figure


def _draw_speed(axes: Axes, time: Array, record: RunRecord) -> None:
    process = fed(record.log)
    feed = record.scenario.process.feed_m_s * 1e3
    value = numbers(record.log, "tcp_speed_m_s")[process] * 1e3
    smooth = moving_average(time, value, 0.05)
    offset = len(value) - len(smooth)
    axes.plot(time, value, color=GREY, lw=0.5, alpha=0.5, label="every sample")
    if len(smooth):
        axes.plot(time[offset // 2 : offset // 2 + len(smooth)], smooth, color=BLUE, label="50 ms average")
    shade_band(axes, feed, 0.01 * feed, "±1%")
    axes.set(ylabel="tool speed [mm/s]", ylim=(0.9 * feed, 1.1 * feed))
    axes.legend(loc="upper right", ncols=3)


def _draw_error(axes: Axes, time: Array, distance: Array, counted: Bools) -> None:
    axes.plot(time, distance * 1e6, color=GREY, lw=0.8, label="ramps, not counted")
    axes.plot(time[counted], distance[counted] * 1e6, color=BLUE)
    top = 1.25 * float(distance.max(initial=0.0))
    if top > 0.5 * PAPER_LIMIT_M:
        axes.axhline(PAPER_LIMIT_M * 1e6, color=ORANGE, ls="--", lw=1.0, label="paper: < 0.3 mm")
    axes.legend(loc="upper right")
    axes.set(xlabel="time since the start of the feed [s]", ylabel="distance from the circle [µm]")
    axes.set_ylim(0.0, max(top * 1e6, 1.0))


def _draw_plane(axes: Axes, positions: Array, circle: Circle) -> None:
    """The circle's plane seen along its normal, the distance from the circle exaggerated."""
    normal = np.asarray(circle.normal)
    across = np.cross([0.0, 0.0, 1.0], normal)
    offset = positions - np.asarray(circle.center)
    u, v = offset @ (across / np.linalg.norm(across)), offset @ np.cross(normal, across / np.linalg.norm(across))
    angle, radius = np.arctan2(v, u), np.hypot(u, v)
    exaggeration = _exaggeration(float(np.abs(radius - circle.radius).max(initial=0.0)), circle.radius)
    shown = circle.radius + exaggeration * (radius - circle.radius)
    ideal = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(circle.radius * np.cos(ideal) * 1e3, circle.radius * np.sin(ideal) * 1e3, color=GREY, lw=1.0, ls="--")
    axes.plot(shown * np.cos(angle) * 1e3, shown * np.sin(angle) * 1e3, color=BLUE)
    if len(positions):
        axes.plot(shown[0] * np.cos(angle[0]) * 1e3, shown[0] * np.sin(angle[0]) * 1e3, "o", color=ORANGE, ms=5)
    axes.set_aspect("equal")
    axes.set(xlabel="across [mm]", ylabel="up [mm]")
    axes.set_title(f"in its plane, error × {exaggeration:g}", fontweight="normal", fontsize=9.0)


def _exaggeration(largest: float, radius: float) -> float:
    """The power of ten that makes the largest error visible without spoiling the circle."""
    return 10.0 ** math.floor(math.log10(SHOWN_SHARE * radius / largest)) if largest > 0.0 else 1.0


def _mm(metrics: object, key: str) -> str:
    value = metrics.get(key) if isinstance(metrics, dict) else None
    return "-" if value is None or np.isnan(value) else f"{value * 1e3:.3g}"


BAND_N = 3.0
_BEFORE_S, _LONGEST_S = 0.5, 6.0


@styled
def plot_force(record: RunRecord) -> Figure:
    """Draw exact and measured force from just before first contact, the ±3 N band, and where the force settles."""
    figure = new_figure(9.0, 4.6)
    axes = figure.add_subplot()
    target = record.scenario.process.contact_force_n
    time, force = response(record)
    measured = numbers(record.log, "wrench_measured_tool")[_shown(record.log), 2]
    shade_band(axes, target, BAND_N, f"{target:g} ± {BAND_N:g} N")
    axes.plot(time, measured, color=GREY, lw=0.6, alpha=0.7, label="as the controller measures it")
    axes.plot(time, force, color=BLUE, lw=1.5, label="exact contact force")
    if first_contact(force) is not None:
        axes.axvline(0.0, color=ORANGE, lw=1.0)
        axes.text(0.0, 0.5 * target, "first contact ", color=ORANGE, ha="right", va="center")
    _mark_settling(axes, record.metrics.get("settling_time_3n_s"), target)
    _frame(axes, time, max(target + 2.5 * BAND_N, float(force.max(initial=0.0)) + BAND_N))
    stop = stop_mark(record.metrics)
    if stop:
        mark_stop((axes,), min(stop.time - _origin(record.log), _LONGEST_S))
    head(figure, axes, f"Force control from first contact, {record.scenario.controller.label}", _facts(record))
    return figure


@styled
def plot_force_runs(records: Sequence[RunRecord]) -> Figure:
    """Draw the force responses of several runs, different controllers or seeds, over each other."""
    figure = new_figure(9.0, 4.6)
    axes = figure.add_subplot()
    targets = sorted({record.scenario.process.contact_force_n for record in records})
    for target in targets:
        shade_band(axes, target, BAND_N, f"{target:g} ± {BAND_N:g} N")
    highest, longest = targets[-1] + 2.5 * BAND_N, np.zeros(1)
    few = len(records) <= len(SERIES)
    for index, record in enumerate(records):
        time, force = response(record)
        named = f"{record.name}: {record.scenario.controller.label}"
        if len(targets) > 1:
            named += f", {record.scenario.process.contact_force_n:g} N"
        color, label = (SERIES[index], named) if few else (BLUE, None)
        axes.plot(time, force, color=color, lw=1.2 if few else 0.6, alpha=1.0 if few else 0.5, label=label)
        highest, longest = max(highest, float(force.max(initial=0.0)) + BAND_N), max(longest, time, key=_end)
    axes.axvline(0.0, color=ORANGE, lw=1.0, label="first contact")
    _frame(axes, longest, highest)
    settled = [_number(record.metrics.get("settling_time_3n_s")) for record in records]
    facts = (f"{len(records)} runs", f"slowest settling to ±{BAND_N:g} N: {max(settled, default=math.nan):.3f} s")
    head(figure, axes, "Force control from first contact", facts)
    return figure


def response(record: RunRecord) -> tuple[Array, Array]:
    """Time since first contact, without one since the start [s], force [N], up to the retract, each shape (n,)."""
    held = _shown(record.log)
    time = numbers(record.log, "time_s")[held]
    force = numbers(record.log, "normal_force_n")[held]
    return time - _origin(record.log), force


def _origin(log: RunLog) -> float:
    """When first contact is, without one the start [s]."""
    held = _shown(log)
    contact = first_contact(numbers(log, "normal_force_n")[held])
    return float(numbers(log, "time_s")[held][contact or 0])


def _shown(log: RunLog) -> Bools:
    """The rows before the retract, shape (n,); all of them where a run stops at its very start."""
    before = before_retract(log)
    return before if before.any() else np.ones_like(before)


def _mark_settling(axes: Axes, settling: float | None, target: float) -> None:
    if settling is None or math.isnan(settling):
        return
    axes.axvline(settling, color=BLUE, lw=1.0, ls=":")
    text = f" inside ±{BAND_N:g} N from {settling:.3f} s on"
    axes.text(settling, 0.15 * target, text, color=BLUE, ha="left", va="center")


def _frame(axes: Axes, time: Array, top: float) -> None:
    axes.set(
        xlabel="time since first contact [s]",
        ylabel="force along the tool axis [N]",
        xlim=(-_BEFORE_S, min(_end(time), _LONGEST_S)),
        ylim=(-1.0, top),
    )
    axes.legend(loc="center right", bbox_to_anchor=(1.0, 0.35))


def _facts(record: RunRecord) -> tuple[str, ...]:
    m = record.metrics
    return (
        f"settling to ±3 N {_text(m.get('settling_time_3n_s'), '.3f', ' s')}, "
        f"to ±1 N {_text(m.get('settling_time_1n_s'), '.3f', ' s')}",
        f"overshoot {_text(m.get('overshoot_n'), '.1f', ' N')}",
        f"in ±3 N after 0.5 s: {_text(m.get('steady_within_3n'), '.1%', '')}",
    )


def _end(time: Array) -> float:
    return float(time[-1])


def _text(value: float | None, form: str, unit: str) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:{form}}{unit}"


def _number(value: float | None) -> float:
    return math.nan if value is None else value


@styled
def plot_seeds(records: Sequence[RunRecord], claims: Sequence[Claim]) -> Figure:
    """Draw every bounded figure of an experiment by seed; what falls short stands out."""
    experiment = records[0].scenario.experiment
    claims = [claim for claim in claims if claim.bounded]
    figure = new_figure(10.0, 1.0 + 1.7 * len(claims))
    panels = figure.subplots(len(claims), 1, sharex=True, squeeze=False)[:, 0]
    for axes, claim in zip(panels, claims, strict=True):
        _draw_claim(axes, claim, records)
    panels[-1].set_xlabel("seed")
    panels[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    name = records[0].scenario.controller.label
    heading(figure, f"{experiment}, {name}: {len(records)} seeds")
    return figure


def _draw_claim(axes: Axes, claim: Claim, records: Sequence[RunRecord]) -> None:
    known = [(r.scenario.seed, r.metrics[claim.figure]) for r in records if r.metrics.get(claim.figure) is not None]
    for seed, value in known:
        axes.plot(seed, value * claim.scale, "o", ms=4.5, color=BLUE if claim.met_by(value) else ORANGE)
    for limit in (claim.low, claim.high):
        if math.isfinite(limit):
            axes.axhline(limit * claim.scale, color=GREEN, ls="--", lw=1.0)
    axes.set_ylabel(f"[{claim.unit}]")
    met = sum(claim.met_by(value) for _, value in known)
    axes.set_title(
        f"{claim.label.strip()}, asked {bound_text(claim)} {claim.unit}: met by {met} of {len(records)}", fontsize=9.0
    )
    axes.margins(y=0.25)
