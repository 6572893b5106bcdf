"""The hand's force over time, every mode of hand guiding in one frame."""

from __future__ import annotations

from textwrap import wrap

import numpy as np
from matplotlib.figure import Figure

from polish_sim.analysis.claim import figure_of
from polish_sim.analysis.run_record import Records, RunRecord
from polish_sim.analysis.style import (
    BLUE,
    DASHES,
    GREEN,
    GREY,
    ORANGE,
    PINK,
    SKY,
    facts_of,
    head,
    line_look,
    new_figure,
    say_instead,
    styled,
)
from polish_sim.arrays import Array, norms
from polish_sim.hand_guiding.drag import distance_to_line
from polish_sim.planning.toolpath import arc_length

COLORS = {"assist": BLUE, "classical": ORANGE, "inertia": SKY, "gravity": PINK, "none": GREY}
PAPER_N = {"none": 100.0, "classical": 30.0, "inertia": 0.714 * 30.0}  #: Peaks of paper 3 [N]
_BEFORE_S, _AFTER_S = 0.1, 0.2


@styled
def plot_guiding(record: RunRecord) -> Figure:
    """Draw the hand's force in every mode, a panel for each direction and pace; dashed the paper's peaks."""
    names = [str(name).rsplit("_", 2) for name in record.metrics["moves"]]
    modes = {mode for mode, *_ in names}
    panels = list(dict.fromkeys((direction, pace) for _mode, direction, pace in names))
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    figure = new_figure(5.5 * columns + 1.0, 3.4 * rows + 0.8)
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for axes, (direction, pace) in zip(grid.flat, panels, strict=False):
        for case, (mode, *place) in enumerate(names):
            time, force = _curve(record, case) if place == [direction, pace] else ((), ())
            if len(time):
                peak = figure_of(record.metrics, f"{record.metrics['moves'][case]}_hand_force_peak_n")
                label = f"{mode}: cut short" if np.isnan(peak) else f"{mode}: {peak:.3g} N"
                dashes = DASHES[list(COLORS).index(mode)]
                axes.plot(time, force, color=COLORS[mode], ls=dashes, lw=1.3, label=label)
        if not axes.lines:
            reason = record.metrics.get("protective_stop") or "no move was begun"
            say_instead(axes, "\n".join(wrap(f"no force to show: {reason}", 60)))
            continue
        for mode, level in PAPER_N.items():
            if mode in modes:
                axes.axhline(level, color=COLORS[mode], lw=1.0, ls=":", alpha=0.8)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
        axes.set(
            xlabel="time from the move's start [s]",
            ylabel=f"{_words(direction, pace)}\nforce of the hand [N]",
        )
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    grid[0, 0].set_ylim(bottom=0.0)
    dashed = any(axes.lines for axes in grid.flat) and PAPER_N.keys() & modes
    facts = [
        "numbers: largest while it moves",
        *(["thin dotted: peaks of paper 3, another robot"] if dashed else []),
    ]
    head(figure, "Force of a hand that guides the arm, by mode", facts)
    return figure


@styled
def plot_guiding_runs(records: Records) -> Figure:
    """Draw the moves several runs of ``teach`` have in common over each other."""
    common = [
        name
        for name in records[0].metrics.get("moves") or ()
        if all(name in (r.metrics.get("moves") or ()) for r in records)
    ]
    figure = new_figure(9.0, 2.8 * max(len(common), 1) + 0.8)
    grid = figure.subplots(max(len(common), 1), 1, squeeze=False, sharex=True)
    for axes, name in zip(grid[:, 0], common, strict=False):
        for number, record in enumerate(records):
            time, force = _curve(record, list(record.metrics["moves"]).index(name))
            axes.plot(time, force, label=record.name, **line_look(number))
        axes.set(ylabel=f"{name.replace('_', ' ')}\nforce [N]")
    grid[-1, 0].set(xlabel="time from the move's start [s]")
    head(
        figure, "Force of a hand that guides the arm", [] if common else ["no move in common"], legend=grid[0]
    )
    return figure


def _curve(record: RunRecord, case: int) -> tuple[Array, Array]:
    """Time from the move's start and norm of the hand's force, from just before the move to just after."""
    log = record.log
    of_case = log["case"] == case
    time = log["time_s"][of_case]
    moving = log.fed[of_case]
    if not moving.any():
        return np.zeros(0), np.zeros(0)
    first, last = time[moving][0], time[moving][-1]
    shown = (time >= first - _BEFORE_S) & (time <= last + _AFTER_S)
    return time[shown] - first, norms(log["hand_force_n"][of_case])[shown]


def _words(direction: str, pace: str) -> str:
    if pace == "path":
        return f"along the {direction}"
    seconds = {"fast": "0.6", "slow": "1"}.get(pace, pace.replace("p", ".").rstrip("s"))
    return f"along {direction} in {seconds} s"


# A path that was taught beside what the hand meant and what was recorded.


@styled
def plot_taught(record: RunRecord) -> Figure:
    """Draw the taught path of a run from above, and its distance from what was meant along it."""
    assert record.path  # without one there is nothing to draw
    T_base_work = np.array(record.metrics["T_base_work"])
    R = T_base_work[:3, :3]
    origin = T_base_work[:3, 3]
    meant = (record.fed("target_position_m") - origin) @ R
    recorded = (record.fed("tcp_position_m") - origin) @ R
    taught = record.path.positions_work
    figure = new_figure(11.0, 4.8)
    above, along = figure.subplots(1, 2, width_ratios=(1.0, 1.2))
    above.plot(*(1e3 * recorded[:, :2].T), color=GREY, lw=0.7, label="recorded")
    above.plot(*(1e3 * meant[:, :2].T), color=GREEN, lw=1.0, ls="--", label="meant")
    above.plot(*(1e3 * taught[:, :2].T), color=BLUE, lw=1.3, label="taught")
    above.set(xlabel="x of the part [mm]", ylabel="y of the part [mm]", aspect="equal")
    for line, off, color, label in ((meant, recorded, GREY, "recorded"), (taught, taught, BLUE, "taught")):
        s = arc_length(line)
        along.plot(100.0 * s / s[-1], 1e3 * distance_to_line(off, meant), color=color, lw=1.0, label=label)
    along.axhline(
        1e3 * figure_of(record.metrics, "taught_deviation_rms_m"),
        color=ORANGE,
        lw=0.9,
        ls="--",
        label="taught, rms",
    )
    along.set(xlabel="share of the way [%]", ylabel="distance from what was meant [mm]", ylim=(0.0, None))
    facts = facts_of(
        record.metrics,
        ("{} points recorded", "points_recorded", 1),
        ("{} knots", "knots", 1),
        ("{} points taught", "points_taught", 1),
        ("off by at most {:.2f} mm", "taught_deviation_max_m", 1e3),
    )
    head(figure, f"Taught on {record.scenario.part.file}", facts, legend=(above, along))
    return figure
