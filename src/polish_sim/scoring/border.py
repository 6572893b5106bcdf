"""Where the force loop breaks: the tool pressed on a plane without noise, and the border of stability.

Both in the cell and in the linear model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, YELLOW, head, new_figure, styled
from polish_sim.arrays import Array
from polish_sim.cell import Cell, RealPart
from polish_sim.cell.linear_arm import arm_modes, joints_about
from polish_sim.config import Checked, Scenario
from polish_sim.control import build_controller
from polish_sim.experiments.assembly import Memory, Workplace, build_cell, build_part, check, place_key
from polish_sim.experiments.part_pose import PartPlacing
from polish_sim.experiments.surface import place_force
from polish_sim.row_file import Row
from polish_sim.scenario_file import override
from polish_sim.scoring.battery import Case, Entry, latency_settings
from polish_sim.scoring.figures import LARGEST_OSCILLATION, LEAST_ALLOWED_N
from polish_sim.scoring.loop_model import FORCE_POSE, longest_latency, one_mass, setup_of, with_springs
from polish_sim.scoring.measured_law import MeasuredLaw, measure_law
from polish_sim.scoring.score import Task, score_rows
from polish_sim.workers import Runner

# Whether a force loop has settled, and the map of where it does.


AT_REST_N = 0.05  #: Swing of the force, peak to peak, below which the loop is at rest [N]
DYING = 0.9  #: A swing that shrinks by this factor in a window is dying away [-]
WINDOW_S = 0.8


class Rest(NamedTuple):
    """How a loop ended."""

    #: No swing, or one that dies away; None: not known, the run's process died or it was not done
    resting: bool | None
    #: Resting, or a swing the scorecard allows: friction of the joints can keep a small one up
    stable: bool | None
    swing: float  #: Of the exact force, peak to peak in the last window [N]
    frequency: float  #: Of that swing [rad/s]
    offset: float  #: Mean force less the wanted one in the last window [N]


LOST = Rest(None, None, math.nan, math.nan, math.nan)


class Border(NamedTuple):
    """Stability over springs and latency, controller by controller."""

    #: Springs of head and pad by what plan and controller take them for, in the cell [-], shape (n,)
    scales: Array
    latencies: Array  #: Sensor and command together, in the cell [s], shape (m,)
    rests: dict[str, list[list[Rest]]]  #: How each run ended, by controller, latency and scale
    line_scales: Array  #: Springs, for the linear model [-], shape (k,)
    #: Latency up to which the linear model is stable [s], by controller (k,); inf: always, NaN: lost
    lines: dict[str, Array]


def judge_rest(force: Array, wanted: float, dt: float) -> Rest:
    """Whether a constant force [N], (n,), has settled, from its last two windows; too short a hold is not at
    rest."""
    rows = round(WINDOW_S / dt)
    if len(force) < 2 * rows:
        return Rest(False, False, math.inf, math.nan, math.nan)
    before, last = force[-2 * rows : -rows], force[-rows:]
    swing, earlier = float(np.ptp(last)), float(np.ptp(before))
    spectrum = np.abs(np.fft.rfft((last - last.mean()) * np.hanning(rows), 8 * rows))
    frequency = 2.0 * math.pi * float(np.argmax(spectrum)) / (8 * rows * dt)
    resting = swing < AT_REST_N or swing < DYING * earlier
    allowed = 2.0 * max(LEAST_ALLOWED_N, LARGEST_OSCILLATION * wanted)
    return Rest(resting, resting or swing <= allowed, swing, frequency, float(last.mean()) - wanted)


QUIET = (
    "part.displacement_m=0",
    "part.rotation_rad=0",
    "part.form_error_m=0",
    "spindle.speed_rpm=0",
    "sensor.force_noise_n=0",
    "sensor.torque_noise_nm=0",
    "sensor.force_drift_n_s=0",
    "sensor.torque_drift_nm_s=0",
    "sensor.force_quantum_n=0",
    "sensor.torque_quantum_nm=0",
)
START_HEIGHT = 0.002  # of the tool above the part [m]
APPROACH_SPEED = 0.004  # [m/s]
FORCE_LIMIT_N = 90.0


class Bench(NamedTuple):
    """The part and the way down to it, for many cells."""

    place: Workplace
    part: RealPart


def quiet(scenario: Scenario) -> Checked:
    """A scenario of ``force`` without noise, on the part as drawn, come down to slowly; forces stop nothing
    early."""
    calm = override(scenario, list(QUIET))
    process = replace(calm.process, approach_speed_m_s=APPROACH_SPEED)
    return check(replace(calm, process=process, safety=replace(calm.safety, force_limit_n=FORCE_LIMIT_N)))


def build_bench(scenario: Scenario) -> Bench:
    """Place the part of a scenario, for cells that differ in latencies and controllers, and in no softer
    springs."""
    calm = quiet(scenario)
    place = place_force(calm)
    low = place.path.positions_work.copy()
    low[0] = low[1] + START_HEIGHT * place.path.axes_work[1]
    path = replace(place.path, positions_work=low, s=np.array([0.0, START_HEIGHT]))
    place = replace(place, path=path, reach=PartPlacing(calm, place.mesh, place.surface, path).reach())
    return Bench(place, build_part(calm, place))


def press_bench(bench: Bench, scenario: Scenario, prepare: Callable[[Cell], None] = lambda _: None) -> Rest:
    """Press on the part, hold, and see whether the force settles; a protective stop counts as unstable.

    Noise and part errors of the scenario are taken out. ``prepare`` may change the cell before it runs.
    """
    calm = quiet(scenario)
    cell = build_cell(calm, bench.place, bench.part)
    prepare(cell)
    trace = cell.run().trace
    held = trace.normal_force_n[trace.fed]
    whole = len(held) >= round(calm.process.hold_s / calm.simulation.timestep_s) - 1
    return judge_rest(held if whole else held[:0], calm.process.contact_force_n, calm.simulation.timestep_s)


# The border, over springs and latency.


SCALES = (0.2, 0.35, 0.6, 1.0, 1.6, 2.5, 3.5, 5.0)  #: Of the springs, for the border in the cell [-]
LATENCIES = (0.002, 0.005, 0.008, 0.014, 0.02, 0.03, 0.045, 0.06)  #: Totals, for the border in the cell [s]
FINE_SCALES: list[float] = np.geomspace(0.1, 10.0, 21).tolist()
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
        mode = float(arm_modes(joints_about(scenario, FORCE_POSE[None]), setup.stiffness)[0])
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
    return press_bench(bench, task.scenario)._asdict()


def measure_border(
    entries: Sequence[Entry],
    runner: Runner,
    scales: Sequence[float] = SCALES,
    latencies: Sequence[float] = LATENCIES,
) -> Border:
    """Stability over springs and latency, simulated and by the linear model, nothing retuned.

    Args:
        entries: The controllers; springs and latencies of their settings play no role.
        runner: Measures the rows.
        scales: Springs of head and pad by what plan and controller take them for, for the cell [-].
        latencies: Totals, for the cell [s].

    A run whose process died again and again, or that Ctrl-C left out, is `LOST`.
    """
    tasks = {entry.label: border_tasks(entry, scales, latencies) for entry in entries}
    rows = score_rows(runner, [task for own in tasks.values() for task in own], border_row)
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
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10)  #: Scales of the springs that are written out [-]


@styled
def plot_border(border: Border) -> Figure:
    """Draw, controller by controller, where the cell came to rest and where the linear model says it
    should."""
    names = list(border.rests)
    first, last, low, high = REACH
    figure = new_figure(1.2 + 3.4 * len(names), 4.6)
    panels = figure.subplots(1, len(names), sharex=True, sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, names, strict=True):
        _draw_line(axes, border, name)
        _draw_runs(axes, border, name)
        axes.add_patch(
            Rectangle(
                (first, low), last - first, high - low, fill=False, ls=":", lw=1.2, ec=GREY, label="reach"
            )
        )
        rests = [rest.stable for row in border.rests[name] for rest in row if rest is not LOST]
        axes.set_title(f"{name}: {rests.count(True)} of {len(rests)} runs stable")
        axes.set_xlabel("latency, sensor and command [ms]")
    axes = panels[0]
    axes.set(
        ylabel="springs by what the plan takes them for [-]",
        yscale="log",
        xlim=(0.0, 1.08e3 * float(border.latencies.max())),
    )
    axes.set_yticks(TICKS, map(str, TICKS))
    axes.minorticks_off()
    axes.set_ylim(border.line_scales.min(), border.line_scales.max())
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
