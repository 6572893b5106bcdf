"""The arc as the paper's figure 12 shows it: speed and tracking error over time, and the circle itself."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polish_sim.analysis.metrics import PAPER_ARC, Circle, distance_to_circle, fed, moving_average, numbers, steady_feed
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.style import BLUE, GREY, ORANGE, SERIES, head, new_figure, shade_band, styled
from polish_sim.arrays import Array, Bools

PAPER_LIMIT_M = 3e-4
SHOWN_SHARE = 0.15
"""In the view of its plane the largest distance from the circle is drawn at most this share of the radius."""


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
    _draw_plane(figure.add_subplot(grid[:, 1]), positions, circle)

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
