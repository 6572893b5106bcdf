"""Figures of two robots: their run, the calibrations of tool, bases and arms, and the error budget."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polish_sim.analysis.run_plots import compare_runs
from polish_sim.analysis.run_record import Records, RunRecord, stop_mark
from polish_sim.analysis.style import (
    AXIS_COLORS,
    BLUE,
    DASHES,
    GREEN,
    GREY,
    HATCHES,
    ORANGE,
    PINK,
    SERIES,
    facts_of,
    head,
    mark_stop,
    new_figure,
    shade_band,
    styled,
)
from polish_sim.arrays import Array, norms, rms
from polish_sim.calibration.arm import fit_placement
from polish_sim.dual import BAND_N
from polish_sim.dual.calibration.bases import Group
from polish_sim.dual.calibration.pair import INSTRUMENTS

if TYPE_CHECKING:
    from polish_sim.dual.budget import PairBudgetTrial, Share
    from polish_sim.dual.calibrate import ArmsFound, BasesFound, TcpCalibration

BAND_MM = 0.1
DARK = "#222222"
_BINS = 50


@styled
def plot_dual(record: RunRecord) -> Figure | None:
    """Draw the errors of the tool on the part over time, and the force if there is one; None before the
    feed."""
    pressing = record.scenario.dual.standoff_m == 0.0
    if not record.log.fed.any():
        return None
    time = record.while_fed("time_s")
    begin = np.nanmin(time)
    figure = new_figure(10.0, 5.8 if pressing else 3.8)
    panels = list(figure.subplots(2 if pressing else 1, 1, sharex=True, squeeze=False)[:, 0])
    error = record.while_fed("relative_error_m")
    for k, color in enumerate(AXIS_COLORS):
        label = f"{'xyz'[k]} of the part"
        panels[0].plot(time - begin, 1e3 * error[:, k], color=color, ls=DASHES[k], lw=1.0, label=label)
    shade_band(panels[0], 0.0, BAND_MM, f"± {BAND_MM:g} mm")
    panels[0].set_ylabel("tool off its place [mm]")
    if pressing:
        _draw_force(panels[1], time - begin, record)
    stop = stop_mark(record.metrics)
    if stop:
        mark_stop(panels, stop.time - begin)
    panels[-1].set_xlabel("time since the start of the feed [s]")
    facts = facts_of(
        record.metrics,
        ("tracking, worst axis {:.3f} mm", "tracking_error_worst_m", 1e3),
        ("tool on the part, rms {:.3f} mm", "relative_error_rms_m", 1e3),
        ("95% below {:.3f} mm", "relative_error_p95_m", 1e3),
        *([("force error at most {:.2f} N", "force_max_deviation_n", 1.0)] if pressing else []),
    )
    head(figure, "Two robots: how far the tool is from its place on the moving part", facts, legend=panels)
    return figure


def plot_dual_runs(records: Records) -> Figure:
    """Draw the tool's error on the part along the path, one line a run."""

    def curve(record: RunRecord) -> tuple[Array, Array]:
        error = 1e3 * norms(record.while_fed("relative_error_m"))
        return record.while_fed("path_s_m"), error

    return compare_runs(
        records, curve, ("rms {:.3f} mm", "relative_error_rms_m", 1e3), (BAND_MM, f"{BAND_MM:g} mm"),
        ("along the path [m]", "error [mm]"), "How far the tool is from its place on the moving part",
    )  # fmt: skip


def _draw_force(axes: Axes, time: Array, record: RunRecord) -> None:
    target = record.scenario.process.contact_force_n
    low, high = (record.while_fed(f"normal_force_{end}_n") for end in ("min", "max"))
    axes.fill_between(time, low, high, color=BLUE, alpha=0.25, lw=0)
    axes.plot(time, record.while_fed("normal_force_n"), color=BLUE, lw=0.7)
    shade_band(axes, target, BAND_N, f"{target:g} ± {BAND_N:g} N")
    reach = max(1.6 * BAND_N, 1.1 * np.nanmax(np.abs([low - target, high - target]), initial=0.0))
    axes.set(ylabel="exact contact force [N]", ylim=(target - reach, target + reach))


@styled
def plot_tool(done: TcpCalibration) -> Figure:
    """Flanges round the touched point with the tool drawn in, and how far each tip was from the fit."""
    tip = done.found.tip
    flanges = done.measured.touches
    figure, space, bars = _canvas()
    for k, T in enumerate(flanges):
        end = T @ done.found.T_flange_tool[:, 3]
        colour = BLUE if tip.used[k] else GREY
        label = {0: "flange to tip"}.get(k)
        space.plot(*np.stack([T[:3, 3], end[:3]], axis=1), color=colour, lw=1.0, alpha=0.6, label=label)
        _draw_frame(space, T, 0.03)
    moved = done.measured.T_base_flange_moves[:, :3] @ np.append(tip.point, 1.0)
    for k, end in enumerate(moved[1:]):
        label = {0: "moves of the tip"}.get(k)
        space.plot(*np.stack([moved[0], end], axis=1), ".--", color=PINK, lw=1.2, label=label)
    _draw_frame(space, flanges[0] @ done.found.T_flange_tool, 0.06, "xyz")
    space.plot(*tip.touched[:, None], "o", color=DARK, ms=5, zorder=10, label="touched point, tool frame")
    _finish(space, "base")
    _residual_bars(bars, [Group("touches", flanges[:, :3, 3], tip.residuals, tip.used)])
    bars.set_xlabel("touch")
    x, y, z = 1e3 * tip.point
    head(
        figure,
        "Calibration of the tool frame",
        [f"tip ({x:.3f}, {y:.3f}, {z:.3f}) ± {1e3 * done.figures['position_std_m']:.3f} mm"],
    )
    return figure


@styled
def plot_bases(done: BasesFound) -> Figure:
    """Measured points, fitted circles, axes and bases in space, and how far each point was from the fit."""
    found = done.found
    figure, space, bars = _canvas()
    turn = np.linspace(0.0, 2.0 * np.pi, 91)
    around = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    for circle in (circle for pair in found.circles.values() for circle in pair):
        space.plot(*(circle.center + circle.radius * around @ circle.frame.T).T, color=GREY, lw=0.7)
        ends = circle.center + 0.4 * np.outer([-1.0, 1.0], circle.axis)
        space.plot(*ends.T, color=GREY, lw=0.9, ls="--")
    points = {group.name: group.points for group in found.groups}
    _draw_bases(space, points, {robot: base.T for robot, base in found.frames.items()})
    _residual_bars(bars, found.groups)
    head(
        figure,
        "Calibration of the bases",
        [
            f"{len(done.figures['outliers'])} left out",
            f"residual {1e3 * done.figures['residual_rms_m']:.3f} mm rms",
        ],
    )
    return figure


@styled
def plot_arms(done: ArmsFound) -> Figure:
    """Tracked points and bases in space, and how far each point was from the fit, nominal table and table
    found."""
    figure, space, bars = _canvas()
    groups = [
        Group(f"{robot}, {what}", one.seen, arm.residuals, np.ones(len(one.seen), dtype=bool))
        for robot, one in done.measured.items()
        for what, arm in (("nominal table", fit_placement(one)), ("table found", done.found.arms[robot]))
    ]
    seen = {robot: one.seen for robot, one in done.measured.items()}
    _draw_bases(space, seen, {robot: arm.T_tracker_base for robot, arm in done.found.arms.items()})
    _residual_bars(bars, groups)
    nominal, found = (1e3 * done.figures[name] for name in ("nominal_rms_m", "heldout_rms_m"))
    head(
        figure,
        "Calibration of the arms",
        [f"nominal: {nominal:.3f} mm rms", f"found, in poses left out: {found:.3f} mm rms"],
    )
    return figure


@styled
def plot_budget(
    trial: PairBudgetTrial, shares: Mapping[str, Share], errors: Array, asked: tuple[float, float]
) -> Figure:
    """Draw each source as analysis and draws have it, and the distribution of the whole error.

    ``errors``: together, draw by draw, work frame [m], (draws, points, 3); ``asked``: largest rms and largest
    95% length [m].
    """
    figure = new_figure(11.0, 4.8)
    left, right = figure.subplots(1, 2)
    _draw_shares(left, shares)
    _draw_lengths(right, norms(errors).ravel(), asked)
    dual = trial.dual
    facts = [
        f"tracker {1e3 * dual.tracker_noise_m:g} mm, touches {1e3 * dual.touch_noise_m:g} mm",
        f"{dual.marks} marks, {dual.closing_touches} closing touches, {len(errors)} calibrations",
    ]
    head(figure, "Error budget of the tool on the part", facts, legend=(left, right))
    return figure


def _draw_shares(axes: Axes, shares: Mapping[str, Share]) -> None:
    place = np.arange(len(shares))
    width = 0.36
    columns = 1e3 * np.array([
        (s.predicted_rms_m, s.predicted_across_rms_m, s.drawn_rms_m, s.drawn_across_rms_m,
         2.0 * s.drawn_rms_std_m)
        for s in shares.values()
    ])  # fmt: skip
    for k, (colour, name) in enumerate(((BLUE, "analysis"), (ORANGE, "drawn"))):
        at = place + (k - 0.5) * width
        across = f"{name}, across the tool axis"
        look: dict[str, Any] = {"color": colour, "hatch": HATCHES[k], "edgecolor": "white"}
        axes.bar(at, columns[:, 2 * k], width, alpha=0.4, label=name, **look)
        axes.bar(at, columns[:, 2 * k + 1], width, label=across, **look)
    spread: dict[str, Any] = {"fmt": "none", "ecolor": GREY, "capsize": 3, "label": "±2 std"}
    axes.errorbar(place + 0.5 * width, columns[:, 2], columns[:, 4], **spread)
    axes.set_xticks(place, [f"{name}\n({INSTRUMENTS.get(name, 'all')})" for name in shares])
    axes.set_ylabel("tool on the part, error, rms [mm]")
    axes.grid(visible=False, axis="x")
    axes.set_ylim(0.0, 1.1 * (columns + columns[:, 4:]).max())


def _draw_lengths(axes: Axes, lengths: Array, asked: tuple[float, float]) -> None:
    axes.hist(1e3 * lengths, bins=_BINS, density=True, color=ORANGE, alpha=0.4, label="drawn, together")
    found = rms(lengths), np.percentile(lengths, 95.0)
    for value, limit, name, style in zip(found, asked, ("rms", "95%"), ("-", "--"), strict=True):
        axes.axvline(1e3 * value, color=ORANGE, ls=style, label=f"{name} {1e3 * value:.3f} mm")
        axes.axvline(1e3 * limit, color=GREEN, ls=style, label=f"{name} asked: {1e3 * limit:.2f} mm")
    axes.set_xlabel("size of the error, over calibrations and places on the rim [mm]")
    axes.set_ylabel("density [1/mm]")


def _canvas() -> tuple[Figure, Any, Axes]:
    figure = new_figure(11.0, 5.2)
    grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
    return figure, figure.add_subplot(grid[0], projection="3d"), figure.add_subplot(grid[1])


def _draw_frame(space: Any, T: Array, size: float, names: str = "") -> None:
    """Axes of a frame, with their names at the ends if there are any; unnamed ones by colour."""
    for axis, colour in enumerate(AXIS_COLORS):
        end = T[:3, 3] + size * T[:3, axis]
        space.plot(*np.stack([T[:3, 3], end], axis=1), color=DARK if names else colour, lw=1.6)
        if names:
            space.text(*(end + 0.12 * size * T[:3, axis]), names[axis], fontsize=8, ha="center", va="center")


def _finish(space: Any, frame: str) -> None:
    """Equal scales, labels with units."""
    for axis in "xyz":
        getattr(space, f"set_{axis}label")(f"{axis}, {frame} [m]")
    space.tick_params(labelsize=7)
    space.set_aspect("equal", "datalim")
    space.locator_params(nbins=4)
    space.legend(loc="upper left", fontsize=7.5)


def _draw_bases(space: Any, seen: Mapping[str, Array], frames: Mapping[str, Array]) -> None:
    """Groups of points and bases by name, as the tracker sees them."""
    for (name, points), colour in zip(seen.items(), SERIES * 2, strict=False):
        space.scatter(*points.T, color=colour, s=4, label=name)
    for name, T in frames.items():
        _draw_frame(space, T, 0.3, "xyz")
        below = T[:3, 3] - 0.2 * T[:3, 2]
        space.text(*below, name, fontsize=9, fontweight="bold", ha="center", va="center", zorder=10)
    # Not along an axis of either arm: circles would look like lines.
    space.view_init(elev=24.0, azim=-32.0)
    _finish(space, "tracker")


def _residual_bars(axes: Axes, groups: Sequence[Group]) -> None:
    first = 1
    for group, colour in zip(groups, SERIES * 2, strict=False):
        number = first + np.arange(len(group.residuals))
        height = 1e3 * norms(group.residuals[group.used])
        axes.vlines(number[group.used], 0.0, height, color=colour, lw=1.0, label=group.name)
        for k in np.flatnonzero(~group.used):
            axes.axvspan(number[k] - 0.5, number[k] + 0.5, color=GREY, alpha=0.35, lw=0)
        first += len(group.residuals) + (len(group.residuals) > 20) * 5
    # An outlier, which is shaded, would flatten everything else.
    kept = [norms(group.residuals[group.used]).max(initial=0.0) for group in groups]
    axes.set_ylim(0.0, max(1.25e3 * max(kept), 1e-9))
    axes.set_xlabel("measurement, group by group")
    axes.set_ylabel("distance from the fit [mm]")
    axes.locator_params(axis="x", integer=True)
    if len(groups) > 1:
        axes.legend(loc="upper right", ncols=2)
