"""Figures of two robots: their run, the calibrations of tool, bases and arms, and the error budget."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polish_sim.analysis.metrics import fed, numbers
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, PINK, SERIES, head, new_figure, shade_band, styled
from polish_sim.arrays import Array, Bools

BAND_MM = 0.1
BAND_N = 1.5
WRIST_3 = 5
LEGEND_SHARE = 0.3
"""Of the errors' range, kept free for their legend."""
DARK = "#222222"
_FRAME_COLOURS = (ORANGE, GREEN, BLUE)
_MANY, _BINS = 100, 50


@styled
def plot_dual(record: RunRecord) -> Figure:
    """Draw a run over time: errors of the tool on the part, force if there is one, and the way of all joints.

    Args:
        record: A run of ``dual``.

    Returns:
        The figure.
    """
    pressing = record.scenario.dual.standoff_m == 0.0
    figure = new_figure(10.0, 7.4 if pressing else 6.2)
    panels = figure.subplots(4 if pressing else 3, 1, sharex=True)
    rows = _from_first_feed_to_last(record)
    time = numbers(record.log, "time_s")[rows]
    time = time - (time[0] if len(time) else 0.0)
    _draw_error(panels[0], time, _while_fed(record, "relative_error_m"))
    if pressing:
        _draw_force(panels[1], time, record)
    for axes, column, name in ((panels[-2], "master_q_rad", "master"), (panels[-1], "q_rad", "follower")):
        _draw_joints(axes, time, numbers(record.log, column)[rows], name)
    panels[-1].set_xlabel("time since the start of the feed [s]")
    panels[-1].legend([f"joint {k}" for k in range(1, 7)], ncols=6, loc="upper center", bbox_to_anchor=(0.5, -0.3))
    m = record.metrics
    facts = [
        f"tracking, worst axis {_mm(m, 'tracking_error_worst_m')} mm",
        f"tool on the part, rms {_mm(m, 'relative_error_rms_m')} mm, 95% below {_mm(m, 'relative_error_p95_m')} mm",
    ]
    if pressing:
        facts.append(f"force error, max {m.get('force_max_deviation_n') or float('nan'):.2f} N")
    head(figure, panels[0], "Two robots: the master moves the part, the follower works on it", facts)
    return figure


@styled
def plot_dual_runs(records: Sequence[RunRecord]) -> Figure:
    """Draw the tool's error on the part along the path, one line a run.

    Args:
        records: Runs of ``dual``.

    Returns:
        The figure.
    """
    figure = new_figure(9.0, 4.0)
    axes = figure.subplots()
    for index, record in enumerate(records):
        error = 1e3 * np.linalg.norm(_while_fed(record, "relative_error_m"), axis=1)
        label = f"{record.name}: rms {_mm(record.metrics, 'relative_error_rms_m')} mm"
        axes.plot(_while_fed(record, "path_s_m"), error, color=SERIES[index % len(SERIES)], label=label)
    axes.axhline(BAND_MM, color=GREEN, ls="--", lw=0.9)
    axes.set(xlabel="along the path [m]", ylabel="error [mm]", ylim=(0.0, None))
    axes.legend()
    head(figure, axes, "Tool on the part, as it is against as wanted", ())
    return figure


def _from_first_feed_to_last(record: RunRecord) -> slice:
    on = np.flatnonzero(fed(record.log))
    return slice(int(on[0]), int(on[-1]) + 1) if len(on) else slice(0, 0)


def _while_fed(record: RunRecord, name: str) -> Array:
    """A column from the first feed to the last; between two strokes no numbers, so that lines break there."""
    rows = _from_first_feed_to_last(record)
    values = numbers(record.log, name)[rows]
    values[~fed(record.log)[rows]] = np.nan
    return values


def _draw_error(axes: Axes, time: Array, error: Array) -> None:
    relative = 1e3 * error
    for k, color in enumerate((BLUE, ORANGE, GREY)):
        axes.plot(time, relative[:, k], color=color, lw=0.9, label=f"{'xyz'[k]} of the part")
    shade_band(axes, 0.0, BAND_MM, f"± {BAND_MM:g} mm")
    axes.set_ylabel("tool on the part [mm]")
    # Below the errors, wherever they run.
    low, high = axes.get_ylim()
    axes.set_ylim(low - LEGEND_SHARE * (high - low), high)
    axes.legend(ncols=4, loc="lower right")


def _draw_force(axes: Axes, time: Array, record: RunRecord) -> None:
    target = record.scenario.process.contact_force_n
    low, high = (_while_fed(record, f"normal_force_{end}_n") for end in ("min", "max"))
    axes.fill_between(time, low, high, color=BLUE, alpha=0.25, lw=0)
    axes.plot(time, _while_fed(record, "normal_force_n"), color=BLUE, lw=0.7, label="exact contact force")
    shade_band(axes, target, BAND_N, f"{target:g} ± {BAND_N:g} N")
    axes.set_ylabel("force [N]")
    axes.legend(ncols=2, loc="lower right")


def _draw_joints(axes: Axes, time: Array, q: Array, name: str) -> None:
    turned = np.degrees(q - q[:1])
    for k in range(6):
        # Wrist 3 often undoes what joint 1 does: dashed, so that both are seen.
        axes.plot(time, turned[:, k], color=SERIES[k % len(SERIES)], ls="--" if k == WRIST_3 else "-")
    axes.set_ylabel(f"{name}: joints\nfrom the start [deg]")


def _mm(metrics: Mapping[str, Any], name: str) -> str:
    value = metrics.get(name)
    return "-" if value is None else f"{1e3 * value:.3f}"


class Residuals(NamedTuple):
    """Residuals of one group of measurements."""

    name: str
    distances: Array
    """[m], shape (n,)."""
    used: Bools
    """Shape (n,)."""


class ToolScene(NamedTuple):
    """Touches of one point."""

    T_base_flange: Array
    """Shape (n, 4, 4)."""
    T_flange_tool: Array
    """Shape (4, 4)."""
    touched: Array
    """The point [m], shape (3,)."""
    moved: Array
    """Tips of the moves, the start first [m], shape (m, 3)."""
    residuals: Residuals


class BaseScene(NamedTuple):
    """Measured points and fitted circles, axes and bases, all in one frame."""

    points: Sequence[tuple[str, Array]]
    """Groups of points [m], each (n, 3)."""
    circles: Sequence[Array]
    """Fitted circles as closed lines [m], each (k, 3)."""
    axes: Sequence[Array]
    """Axes as lines [m], each (2, 3)."""
    frames: Sequence[tuple[str, Array]]
    """Bases, each (4, 4)."""
    residuals: Sequence[Residuals]
    frame: str
    """Whose frame it is, for the axes."""


@styled
def plot_tool(scene: ToolScene, title: str, facts: Sequence[str]) -> Figure:
    """Flanges round the touched point with the tool drawn in, and how far each tip was from the fit."""
    figure, space, bars = _canvas()
    for k, T in enumerate(scene.T_base_flange):
        tip = T @ scene.T_flange_tool[:, 3]
        colour = BLUE if scene.residuals.used[k] else GREY
        label = {0: "flange to tip"}.get(k)
        space.plot(*np.stack([T[:3, 3], tip[:3]], axis=1), color=colour, lw=1.0, alpha=0.6, label=label)
        _draw_frame(space, T, 0.03)
    for k, end in enumerate(scene.moved[1:]):
        label = {0: "moves of the tip"}.get(k)
        space.plot(*np.stack([scene.moved[0], end], axis=1), ".--", color=PINK, lw=1.2, label=label)
    tool = scene.T_base_flange[0] @ scene.T_flange_tool
    _draw_frame(space, tool, 0.06, "xyz")
    space.plot(*scene.touched[:, None], "o", color=DARK, ms=5, zorder=10, label="touched point, tool frame")
    _finish(space, np.concatenate([scene.T_base_flange[:, :3, 3], scene.touched[None]]), "base")
    _residual_bars(bars, [scene.residuals])
    bars.set_xlabel("touch")
    head(figure, bars, title, facts)
    return figure


@styled
def plot_bases(scene: BaseScene, title: str, facts: Sequence[str]) -> Figure:
    """Measured points, fitted circles, axes and bases in space, and how far each point was from the fit."""
    figure, space, bars = _canvas()
    for (name, points), colour in zip(scene.points, SERIES * 2, strict=False):
        space.scatter(*points.T, color=colour, s=4, label=name)
    for line in scene.circles:
        space.plot(*line.T, color=GREY, lw=0.7)
    for line in scene.axes:
        space.plot(*line.T, color=GREY, lw=0.9, ls="--")
    for name, T in scene.frames:
        _draw_frame(space, T, 0.3, "xyz")
        below = T[:3, 3] - 0.2 * T[:3, 2]
        space.text(*below, name, fontsize=9, fontweight="bold", ha="center", va="center", zorder=10)
    # Not along an axis of either arm: circles would look like lines.
    space.view_init(elev=24.0, azim=-32.0)
    everything = [points for _, points in scene.points] + [T[None, :3, 3] for _, T in scene.frames]
    _finish(space, np.concatenate(everything), scene.frame)
    _residual_bars(bars, scene.residuals)
    bars.set_xlabel("measurement, group by group")
    head(figure, bars, title, facts)
    return figure


def _canvas() -> tuple[Figure, Any, Axes]:
    figure = new_figure(11.0, 5.2)
    grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
    return figure, figure.add_subplot(grid[0], projection="3d"), figure.add_subplot(grid[1])


def _draw_frame(space: Any, T: Array, size: float, names: str = "") -> None:
    """Axes of a frame, with their names at the ends if there are any; unnamed ones by colour."""
    for axis, colour in enumerate(_FRAME_COLOURS):
        end = T[:3, 3] + size * T[:3, axis]
        space.plot(*np.stack([T[:3, 3], end], axis=1), color=DARK if names else colour, lw=1.6)
        if names:
            space.text(*(end + 0.12 * size * T[:3, axis]), names[axis], fontsize=8, ha="center", va="center")


def _finish(space: Any, points: Array, frame: str) -> None:
    """Equal scales, labels with units."""
    middle, reach = 0.5 * (points.max(axis=0) + points.min(axis=0)), 0.55 * float(np.ptp(points, axis=0).max())
    for axis, center in zip("xyz", middle, strict=True):
        getattr(space, f"set_{axis}lim")(center - reach, center + reach)
        getattr(space, f"set_{axis}label")(f"{axis}, {frame} [m]")
        space.tick_params(axis, labelsize=7)
    space.set_box_aspect((1, 1, 1))
    space.locator_params(nbins=4)
    space.legend(loc="upper left", fontsize=7.5)


def _residual_bars(axes: Axes, groups: Sequence[Residuals]) -> None:
    first = 1
    for group, colour in zip(groups, SERIES * 2, strict=False):
        number = first + np.arange(len(group.distances))
        width = 1.4 if len(number) < _MANY else 0.5
        axes.vlines(
            number[group.used], 0.0, 1e3 * group.distances[group.used], color=colour, lw=width, label=group.name
        )
        for k in np.flatnonzero(~group.used):
            axes.axvspan(number[k] - 0.5, number[k] + 0.5, color=GREY, alpha=0.35, lw=0)
        first += len(group.distances) + (len(group.distances) > 20) * 5
    # An outlier, which is shaded, would flatten everything else.
    kept = [group.distances[group.used].max(initial=0.0) for group in groups]
    axes.set_ylim(0.0, max(1.25e3 * max(kept), 1e-9))
    axes.set_ylabel("distance from the fit [mm]")
    axes.locator_params(axis="x", integer=True)
    if len(groups) > 1:
        for line in axes.legend(loc="upper right", ncols=2).get_lines():
            line.set_linewidth(1.4)


class Bar(NamedTuple):
    """Root mean squares of one source [m]."""

    predicted: float
    predicted_across: float
    """Across the tool axis only."""
    drawn: float
    drawn_across: float
    drawn_std: float
    """Standard error of ``drawn``."""


class Total(NamedTuple):
    """The whole error."""

    lengths: Array
    """Of all draws and places [m], shape (n,)."""
    edges: Array
    """Lengths the prediction is given at [m], rising, shape (k,)."""
    probability: Array
    """Predicted share of errors no longer than each, shape (k,)."""
    rms_asked: float
    p95_asked: float


@styled
def plot_budget(bars: Mapping[str, Bar], total: Total, title: str, facts: Sequence[str]) -> Figure:
    """Draw bars of the sources, analysis beside draws, and the distribution of the whole with what is asked of it."""
    figure = new_figure(11.0, 4.8)
    left, right = figure.subplots(1, 2)
    _draw_bars(left, bars)
    _draw_total(right, total)
    head(figure, left, title, facts)
    return figure


def _draw_bars(axes: Axes, bars: Mapping[str, Bar]) -> None:
    place, width = np.arange(len(bars)), 0.36
    columns = 1e3 * np.array(list(bars.values()))
    for shift, colour, name, first in ((-0.5, BLUE, "analysis", 0), (0.5, ORANGE, "drawn", 2)):
        axes.bar(place + shift * width, columns[:, first], width, color=colour, alpha=0.4, label=name)
        axes.bar(
            place + shift * width, columns[:, first + 1], width, color=colour, label=f"{name}, across the tool axis"
        )
    axes.errorbar(
        place + 0.5 * width, columns[:, 2], 2.0 * columns[:, 4], fmt="none", ecolor=GREY, capsize=3, label="±2 std"
    )
    axes.set_xticks(place, list(bars))
    axes.set_ylabel("tool on the part, error, rms [mm]")
    axes.grid(visible=False, axis="x")
    axes.set_ylim(0.0, 1.35 * columns.max())
    axes.legend(loc="upper left", ncols=2)


def _draw_total(axes: Axes, total: Total) -> None:
    edges = 1e3 * total.edges
    axes.hist(
        1e3 * total.lengths,
        bins=_BINS,
        range=(0.0, edges[-1]),
        density=True,
        color=ORANGE,
        alpha=0.4,
        label="drawn, together",
    )
    density = np.diff(total.probability) / np.diff(edges)
    axes.plot(0.5 * (edges[1:] + edges[:-1]), density, color=BLUE, lw=1.6, label="analysis, together")
    rms, p95 = float(np.sqrt(np.mean(total.lengths**2))), float(np.percentile(total.lengths, 95.0))
    for value, asked, name, style in ((rms, total.rms_asked, "rms", "-"), (p95, total.p95_asked, "95%", "--")):
        axes.axvline(1e3 * value, color=ORANGE, ls=style, label=f"{name} {1e3 * value:.3f} mm")
        axes.axvline(1e3 * asked, color=GREEN, ls=style, label=f"{name} asked: {1e3 * asked:.2f} mm")
    axes.set_xlabel("size of the error, over calibrations and places on the rim [mm]")
    axes.set_ylabel("density [1/mm]")
    axes.legend(loc="upper right", frameon=True, framealpha=1.0, edgecolor="none")
