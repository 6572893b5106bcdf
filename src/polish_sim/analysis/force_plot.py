"""The step response of the contact force as the paper's figure 13 shows it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polish_sim.analysis.metrics import before_retract, first_contact, numbers
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.style import BLUE, GREY, ORANGE, SERIES, head, new_figure, shade_band, styled
from polish_sim.arrays import Array, Bools
from polish_sim.log import RunLog

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
    contact = first_contact(force)
    return time - (time[contact] if contact is not None else time[0]), force


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
