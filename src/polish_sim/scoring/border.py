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
from polish_sim.arrays import Array
from polish_sim.cell import SILENT, Observer
from polish_sim.cell.linear_arm import arm_modes
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.scoring.force_bench import Border, Rest, build_bench, press
from polish_sim.scoring.loop_model import FORCE_POSE, one_mass, setup_of
from polish_sim.scoring.margins import (
    longest_latency,
    share_latency,
    with_springs,
)
from polish_sim.scoring.measured_law import MeasuredLaw, measure_law

SCALES = (0.2, 0.35, 0.6, 1.0, 1.6, 2.5, 3.5, 5.0)  #: Of the springs, for the border in the cell [-]
LATENCIES = (0.002, 0.005, 0.008, 0.014, 0.02, 0.03, 0.045, 0.06)  #: Totals, for the border in the cell [s]
FINE_SCALES = tuple(float(s) for s in np.geomspace(0.1, 10.0, 21))
FINE_LATENCIES = tuple(0.001 * n for n in range(1, 121))


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


def measure_border(
    scenario: Scenario,
    controllers: Sequence[str],
    observer: Observer = SILENT,
    scales: Sequence[float] = SCALES,
    latencies: Sequence[float] = LATENCIES,
) -> Border:
    """Stability over springs and latency, simulated and by the linear model, nothing retuned.

    Args:
        scenario: An experiment ``force``; its springs and latencies play no role.
        controllers: Names, or FILE.py:CLASS.
        observer: Receives the progress.
        scales: Springs of head and pad by what plan and controller take them for, for the cell [-].
        latencies: Totals, for the cell [s].
    """
    observer.stage("set up")
    softest = replace(scenario, head=replace(scenario.head, spring_scale=min(scales)))
    bench = build_bench(softest)
    total, done = len(controllers) * len(scales) * len(latencies), 0
    rests: dict[str, list[list[Rest]]] = {}
    for name in controllers:
        observer.stage(f"press, {name}")
        rests[name] = []
        for latency in latencies:
            rests[name].append([press(bench, _at(scenario, name, scale, latency)) for scale in scales])
            done += len(scales)
            observer.progress(done, total)
    lines = {name: border_line(scenario, name, FINE_SCALES) for name in controllers}
    return Border(np.array(scales), np.array(latencies), rests, np.array(FINE_SCALES), lines)


def border_line(scenario: Scenario, name: str, scales: Sequence[float]) -> Array:
    """Latency up to which the linear model of a controller is stable [s], for each scale of the springs,
    shape (n,).

    The law is the one that has settled on these springs at the scenario's latency; where it does not settle,
    the one settled on the springs of the drawing.
    """
    drawn = _at(scenario, name, 1.0, scenario.sensor.latency_s + scenario.robot.command_latency_s)
    setup, longest = setup_of(drawn), np.zeros(len(scales))
    at_home = linear_law_of(drawn)
    for k, scale in enumerate(scales):
        law = linear_law_of(drawn, scale)
        longest[k] = longest_latency(
            with_springs(setup, scale), law if law.settled else at_home, FINE_LATENCIES
        )
    return longest


def _at(scenario: Scenario, name: str, scale: float, latency: float) -> Scenario:
    shared = share_latency(latency)
    return replace(
        scenario,
        controller=replace(scenario.controller, name=name),
        head=replace(scenario.head, spring_scale=scale),
        sensor=replace(scenario.sensor, latency_s=shared.sensor),
        robot=replace(scenario.robot, command_latency_s=shared.command),
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
        rests = [rest.stable for row in border.rests[name] for rest in row]
        axes.set_title(f"{name}: {sum(rests)} of {len(rests)} runs stable", fontsize=9.5)
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
