"""Search for the worst a controller does: the largest force, the longest loss of contact, the largest error.

    maximise f(run(x)) over x in stated ranges

x is the part, the seed, how the part lies, the springs, latencies, approach speed and feed (`RANGES`). An
evolution of vectors (`scipy.optimize.differential_evolution`) looks for each of the three figures in turn;
every run counts for all of them. A run lands on a part and feeds for two seconds, set up as `run surface`
sets it up, so that its config repeats it. This is falsification: what is found is a counterexample, what is
not found is no proof.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from polish_sim.arrays import Array
from polish_sim.config import Checked, Scenario
from polish_sim.experiments.assembly import build_cell, build_part, check
from polish_sim.experiments.registry import default_scenario
from polish_sim.experiments.surface import SurfaceTask, prepare_surface
from polish_sim.scenario_file import merge

PARTS = ("plate", "sphere_100", "freeform")
#: Springs as they are by what plan and controller take them for [-]
STIFFER = (0.25, 0.5, 1.0, 2.0, 4.0)
RANGES: Mapping[str, tuple[float, float]] = {
    "part": (0.0, len(PARTS) - 1e-9),
    "head.spring_scale": (0.0, len(STIFFER) - 1e-9),
    "seed": (500.0, 100_000.0),
    "part.displacement_m": (0.0, 0.003),
    "part.rotation_rad": (0.0, math.radians(2.0)),
    "robot.command_latency_s": (0.002, 0.010),
    "sensor.latency_s": (0.001, 0.004),
    "process.approach_speed_m_s": (0.002, 0.010),
    "process.feed_m_s": (0.005, 0.040),
}
"""Bounds of each key that is searched; of part and springs, numbers in their lists."""
FEED_S = 2.0  #: A run is fed for this long [s]
GROWN = 4  #: Vectors of a generation by keys
FIGURES = ("worst_peak_force_n", "worst_contact_lost_s", "worst_error_n")
SETTLED_S = 0.3  #: After the feed begins, before errors count [s]


class WorstRun(NamedTuple):
    """The worst of one figure."""

    value: float
    scenario: Checked
    stopped: str  #: Why the robot stopped itself in that run; empty if it did not


class Worst(NamedTuple):
    """What a search found."""

    found: Mapping[str, WorstRun]  #: By the names of ``FIGURES``
    runs: int
    stops: int  #: Runs that ended in a protective stop


class _Enough(Exception):
    """The runs asked for are done."""


def search_worst(scenario: Scenario, runs: int, progress: Callable[[int, int], None]) -> Worst:
    """Search with a number of runs of a ``scenario``'s controller and settings; Ctrl-C returns what was
    found."""
    tasks: dict[str, SurfaceTask] = {}
    found: dict[str, WorstRun] = {}
    done, stops = 0, 0

    def run(x: Array) -> tuple[float, float, float]:
        nonlocal done, stops
        if done >= runs:
            raise _Enough
        drawn = check(drawn_scenario(scenario, x))
        figures, stopped = _measure(drawn, tasks)
        done, stops = done + 1, stops + bool(stopped)
        for name, value in zip(FIGURES, figures, strict=True):
            if name not in found or value > found[name].value:
                found[name] = WorstRun(value, drawn, stopped)
        progress(done, runs)
        return figures

    try:
        for number in range(len(FIGURES)):
            budget = runs * (number + 1) // len(FIGURES) - done
            keys = len(RANGES)
            generations = max(1, math.ceil(budget / (GROWN * keys)) - 1)
            differential_evolution(
                lambda x, number=number: -run(x)[number],
                list(RANGES.values()),
                popsize=GROWN,
                maxiter=generations,
                tol=0.0,
                polish=False,
                rng=np.random.default_rng(number),
                init="sobol",
            )
    except (_Enough, KeyboardInterrupt):
        pass
    return Worst(found, done, stops)


def worst_base(controller: str) -> Scenario:
    """The scenario of a search: `surface`, landing from close by and fed for a moment."""
    table = {"plan": {"clearance_m": 0.01, "stepover_m": 0.02}, "process": {"max_feed_s": FEED_S}}
    return merge(
        default_scenario("surface"),
        {**table, "controller": {"name": controller}, "safety": {"proof": "none"}},
        "",
    )


def drawn_scenario(scenario: Scenario, x: Array) -> Scenario:
    """The scenario of a vector (9,) of `RANGES`."""
    values = dict(zip(RANGES, x.tolist(), strict=True))
    table: dict[str, dict[str, object]] = {
        "part": {"file": PARTS[int(values.pop("part"))]},
        "head": {"spring_scale": STIFFER[int(values.pop("head.spring_scale"))]},
    }
    seed = int(values.pop("seed"))
    for name, value in values.items():
        section, _, key = name.partition(".")
        table.setdefault(section, {})[key] = value
    return replace(merge(scenario, table, ""), seed=seed)


def _measure(scenario: Checked, tasks: dict[str, SurfaceTask]) -> tuple[tuple[float, float, float], str]:
    part = scenario.part.file
    if part not in tasks:
        tasks[part] = prepare_surface(scenario)
    place = tasks[part].place
    run = build_cell(scenario, place, build_part(scenario, place)).run()
    trace, wanted = run.trace, scenario.process.contact_force_n
    force, time, fed = trace.normal_force_n, trace.time_s, trace.fed
    begun = time[fed][0] + SETTLED_S if fed.any() else math.inf
    lost = float((force[fed] < 0.5).sum()) * scenario.simulation.timestep_s
    error = float(np.abs(force[fed & (time > begun)] - wanted).max(initial=0.0))
    return (float(force.max()), lost, error), run.stop_reason or ""
