"""Where the force loop breaks: margins and the border of stability, from the linear model and in the cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, YELLOW, head, new_figure, styled
from polish_sim.cell.linear_arm import arm_modes
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.experiments.assembly import Memory, place_key
from polish_sim.row_file import Row
from polish_sim.scoring.battery import Case, Entry, latency_settings
from polish_sim.scoring.force_bench import LOST, Border, Rest, build_bench, press
from polish_sim.scoring.journal import Task
from polish_sim.scoring.loop_model import FORCE_POSE, one_mass, setup_of
from polish_sim.scoring.margins import longest_latency, with_springs
from polish_sim.scoring.measured_law import MeasuredLaw, measure_law
from polish_sim.scoring.score import Scorer
from polish_sim.workers import Heard

SCALES = (0.2, 0.35, 0.6, 1.0, 1.6, 2.5, 3.5, 5.0)  #: Of the springs, for the border in the cell [-]
LATENCIES = (0.002, 0.005, 0.008, 0.014, 0.02, 0.03, 0.045, 0.06)  #: Totals, for the border in the cell [s]
FINE_SCALES = tuple(float(s) for s in np.geomspace(0.1, 10.0, 21))
FINE_LATENCIES = tuple(0.001 * n for n in range(1, 121))
MODEL = "linear model"
_BENCHES = Memory()  #: On the softest springs: the part is modelled deeply enough for all


def linear_law_of(scenario: Scenario, scale: float = 1.0) -> MeasuredLaw:
    """The force law of a scenario's controller made linear, settled on springs ``scale`` times as stiff as
    drawn.

    It settles on an ideal arm: it is to be the law of this cell though it may swing there. Of an elastic one
    it knows the vibration in the pose of ``force``, as from the course.
    """
    controller = scenario.controller
    setup = setup_of(replace(scenario, head=replace(scenario.head, spring_scale=1.0)), one_mass())
    if scenario.robot.elastic and controller.adaptive.arm_mode_hz:
        mode = float(arm_modes(scenario, setup.stiffness, FORCE_POSE[None])[0])
        known = replace(controller.adaptive, arm_mode_hz=mode / (2.0 * math.pi))
        controller = replace(controller, adaptive=known)
    return measure_law(
        build_controller(controller), with_springs(setup, scale), scenario.process.contact_force_n,
        setup.stiffness,
    )  # fmt: skip


def border_tasks(
    entry: Entry, scales: Sequence[float] = SCALES, latencies: Sequence[float] = LATENCIES
) -> list[Task]:
    """The runs of the cell, latency by latency, and the springs of the linear model's line."""
    cell = [("cell", scale, latency_settings(1e3 * latency)) for latency in latencies for scale in scales]
    line = [(MODEL, scale, ()) for scale in FINE_SCALES]
    return [
        Task(Case(f"springs x {scale:g}, {of}", of, "force", (f"head.spring_scale={scale}", *more)), entry, 0)
        for of, scale, more in [*cell, *line]
    ]


def border_row(task: Task) -> Row:
    """How the cell comes to rest with a task's springs and latency, or the end of the model's line there."""
    if task.case.text == MODEL:
        return {"longest_s": longest_stable(task.scenario)}
    softest = replace(task.scenario, head=replace(task.scenario.head, spring_scale=SCALES[0]))
    bench = _BENCHES.get(place_key(softest), lambda: build_bench(softest))
    return press(bench, task.scenario)._asdict()


def measure_border(
    entries: Sequence[Entry],
    scorer: Scorer,
    heard: Heard,
    scales: Sequence[float] = SCALES,
    latencies: Sequence[float] = LATENCIES,
) -> Border:
    """Stability over springs and latency, simulated and by the linear model, nothing retuned.

    Args:
        entries: The controllers; springs and latencies of their settings play no role.
        scorer: Measures the rows.
        heard: Receives the progress.
        scales: Springs of head and pad by what plan and controller take them for, for the cell [-].
        latencies: Totals, for the cell [s].

    A run whose process died again and again is `LOST`.
    """
    tasks = {entry.label: border_tasks(entry, scales, latencies) for entry in entries}
    rows = scorer.rows([task for own in tasks.values() for task in own], heard, border_row)
    rests, lines = {}, {}
    for label, own in tasks.items():
        cell, line = ([rows.get(t) for t in own if (t.case.text == MODEL) == of] for of in (False, True))
        ends = [Rest(**row) if row else LOST for row in cell]
        rests[label] = [ends[k : k + len(scales)] for k in range(0, len(ends), len(scales))]
        latest = [row["longest_s"] if row else math.nan for row in line]
        lines[label] = np.array([math.inf if latency is None else latency for latency in latest])
    return Border(np.array(scales), np.array(latencies), rests, np.array(FINE_SCALES), lines)


def longest_stable(scenario: Scenario) -> float:
    """Latency up to which the linear model of a scenario's controller is stable on its springs [s].

    The law is the one that has settled on these springs at the scenario's latency; where it does not settle,
    the one settled on the springs of the drawing.
    """
    scale = scenario.head.spring_scale
    law = linear_law_of(scenario, scale)
    setup = setup_of(replace(scenario, head=replace(scenario.head, spring_scale=1.0)))
    return longest_latency(
        with_springs(setup, scale), law if law.settled else linear_law_of(scenario), FINE_LATENCIES
    )


# The map of where a force loop is stable: springs over latency, model and cell.

#: Latency [ms] and scale of the springs a controller should bear without retuning
REACH = (2.0, 20.0, 0.2, 5.0)


@styled
def plot_border(border: Border) -> Figure:
    """Draw, controller by controller, where the cell came to rest and where the linear model says it
    should."""
    names = list(border.rests)
    figure = new_figure(1.2 + 3.4 * len(names), 4.6)
    panels = figure.subplots(1, len(names), sharex=True, sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, names, strict=True):
        _draw_line(axes, border, name)
        _draw_runs(axes, border, name)
        _draw_reach(axes)
        rests = [rest.stable for row in border.rests[name] for rest in row if rest is not LOST]
        axes.set_title(f"{name}: {rests.count(True)} of {len(rests)} runs stable", fontsize=9.5)
        axes.set_xlabel("latency, sensor and command [ms]")
    panels[0].set_ylabel("springs by what the plan takes them for [-]")
    _scale(panels[0], border)
    head(figure, "Where the force loop breaks, nothing retuned", legend=panels)
    return figure


def _draw_line(axes: Axes, border: Border, name: str) -> None:
    top = 2e3 * float(border.latencies.max())
    latest = np.minimum(1e3 * border.lines[name], top)
    axes.fill_betweenx(
        border.line_scales, latest, top, color=ORANGE, alpha=0.10, lw=0, label="unstable by the model"
    )
    axes.plot(
        np.where(latest < top, latest, np.nan), border.line_scales, color=BLUE, lw=1.6, label="border, model"
    )


def _draw_runs(axes: Axes, border: Border, name: str) -> None:
    runs = [
        (1e3 * latency, scale, "rest" if rest.resting else "swing" if rest.stable else "unstable")
        for latency, row in zip(border.latencies, border.rests[name], strict=True)
        for scale, rest in zip(border.scales, row, strict=True)
        if rest is not LOST
    ]
    for kind, (label, marker, color) in _LOOKS.items():
        points = np.array([run[:2] for run in runs if run[2] == kind]).reshape(-1, 2)
        axes.plot(points[:, 0], points[:, 1], ls="", marker=marker, color=color, ms=5.0, mew=1.4, label=label)


_LOOKS = {
    "rest": ("cell: at rest", "o", GREEN),
    "swing": ("cell: swings by less than ±2 N", "d", YELLOW),
    "unstable": ("cell: unstable", "x", ORANGE),
}


def _draw_reach(axes: Axes) -> None:
    first, last, low, high = REACH
    axes.add_patch(
        Rectangle((first, low), last - first, high - low, fill=False, ls=":", lw=1.2, ec=GREY, label="reach")
    )


def _scale(axes: Axes, border: Border) -> None:
    axes.set_yscale("log")
    axes.set_ylim(border.line_scales.min(), border.line_scales.max())
    axes.set_xlim(0.0, 1.08e3 * float(border.latencies.max()))
    axes.yaxis.set_major_locator(FixedLocator([0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
