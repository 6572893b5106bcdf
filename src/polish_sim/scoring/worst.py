"""Search for the worst a controller does: the largest force, the longest loss of contact, the largest error.

    maximise f(run(x)) over x in stated ranges

x is the part, the seed, how the part lies, the springs, latencies, approach speed and feed (`RANGES`). An
evolution of vectors (`scipy.optimize.differential_evolution`) looks for each of the three figures in turn,
from the same evenly spread vectors; every run counts for all of them. A run is a row of the score: it lands
on a part and feeds for two seconds, set up as `run surface` sets it up, so that its config repeats it. This
is falsification: what is found is a counterexample, what is not found is no proof.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from polish_sim.arrays import Array
from polish_sim.errors import InputError
from polish_sim.row_file import Row
from polish_sim.scoring.battery import Case, Entry
from polish_sim.scoring.score import Task, score_rows
from polish_sim.workers import Runner

LISTS: Mapping[str, tuple[object, ...]] = {
    "part.file": ("plate", "sphere_100", "freeform"),
    "head.spring_scale": (0.25, 0.5, 1.0, 2.0, 4.0),
}
"""Parts, and springs as they are by what plan and controller take them for [-]."""
RANGES: Mapping[str, tuple[float, float]] = {
    **{key: (0.0, len(values) - 1e-9) for key, values in LISTS.items()},
    "seed": (500.0, 100_000.0),
    "part.displacement_m": (0.0, 0.003),
    "part.rotation_rad": (0.0, math.radians(2.0)),
    "robot.command_latency_s": (0.002, 0.010),
    "sensor.latency_s": (0.001, 0.004),
    "process.approach_speed_m_s": (0.002, 0.010),
    "process.feed_m_s": (0.005, 0.040),
}
"""Bounds of each key that is searched; of `LISTS` the places in them. A setting of the controller's own goes
before."""
CASE = Case(
    "worst",
    "landing from close by, fed for 2 s",
    "surface",
    ("plan.clearance_m=0.01", "plan.stepover_m=0.02", "process.max_feed_s=2", "safety.proof=none"),
)
GENERATION = 16  #: Vectors at a time
FIGURES: Mapping[str, str] = {
    "worst_peak_force_n": "largest_force_n",
    "worst_contact_lost_s": "contact_lost_s",
    "worst_error_n": "max_error_n",
}
"""The score's figures that are searched, by what the largest of each is called."""


class _Enough(Exception):
    """The runs asked for are done, or Ctrl-C came."""


def search_worst(entry: Entry, runs: int, runner: Runner) -> dict[Task, Row]:
    """Search with a number of runs of a controller: the rows of all; Ctrl-C ends it early.

    A search that was interrupted makes the same runs again, whose rows are kept.

    Raises:
        InputError: If none of the runs could be set up.
    """
    rows: dict[Task, Row] = {}

    def costs(x: Array, figure: str) -> Array:
        tasks = [drawn_task(entry, one) for one in x.T]
        before = len(rows)
        fresh = [task for task in dict.fromkeys(tasks) if task not in rows][: runs - before]
        found = score_rows(runner, fresh, heard=lambda n, _, what: runner.heard(before + n, runs, what))
        rows.update(found)
        if runner.interrupted or len(rows) >= runs:
            raise _Enough
        return np.array([-size_of(rows.get(task, {}), figure) for task in tasks])

    with suppress(_Enough):
        for number, figure in enumerate(FIGURES.values()):
            left = (runs - max(len(rows), GENERATION)) / (len(FIGURES) - number)
            differential_evolution(
                costs,
                list(RANGES.values()),
                args=(figure,),
                maxiter=max(1, math.ceil(left / GENERATION)),
                init=first_vectors(),
                tol=0.0,
                polish=False,
                rng=number,
                updating="deferred",
                vectorized=True,
            )
    if not any(row["duration"] for row in rows.values()):
        raise InputError(f"no run could be set up: {next(iter(rows.values()))['protective_stop']}.")
    return rows


def size_of(row: Row, figure: str) -> float:
    """A figure of a run; 0 where it has none, as without contact."""
    return row.get(figure) or 0.0


def first_vectors() -> Array:
    """The vectors every search begins with, evenly spread over `RANGES`, shape (16, 9)."""
    low, high = np.array(list(RANGES.values())).T
    return low + (high - low) * qmc.Sobol(len(RANGES), rng=0).random(GENERATION)


def first_tasks(entry: Entry) -> list[Task]:
    """Their runs."""
    return [drawn_task(entry, x) for x in first_vectors()]


def drawn_task(entry: Entry, x: Array) -> Task:
    """The run of a vector (9,) of `RANGES`."""
    values = dict(zip(RANGES, x.tolist(), strict=True))
    seed = int(values.pop("seed"))
    sets = [f"{key}={LISTS[key][int(v)] if key in LISTS else v}" for key, v in values.items()]
    return Task(replace(CASE, settings=(*CASE.settings, *sets)), entry, seed)
