"""What a run learns from one before it: how deep the tool has to go at each place of the path, fed forward.

Iterative learning control (Bristow, Tharayil and Alleyne, IEEE Control Systems 26(3), 96-114, 2006):

    h(s) = z . (p - p_target) + (F_set - F) / k,     u += dh/ds ds/dt

Position and force are what the host of the run before knew, k the springs as drawn. h holds the part as it
lies and is bent, and what the gears err in that pose of the arm. It is low-passed without delay at
sqrt(k/m) / 2 pi, m the mass the sensor carries: the gears' errors move that mass unseen by the encoders, and
at that frequency its inertia takes all of the force out of the reading.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from polish_sim.analysis.metrics import numbers
from polish_sim.analysis.run_record import differences, read_record
from polish_sim.cell.kernel import Lesson
from polish_sim.config import Checked, Scenario
from polish_sim.control import Controller
from polish_sim.errors import InputError
from polish_sim.experiments.placement import Reach
from polish_sim.planning.toolpath import ToolPath

SPACING = 0.0005  #: Of the places at which it is learned [m]
SHORTEST_S = 0.5  #: A stretch in contact from which something is learned [s]
SAME = ("part", "robot", "head", "pad", "process", "smoothing")
"""Sections that decide what repeats."""
FREE = ("part.pose", "process.learn", "process.preston_1_pa")
"""Keys of these that may differ; where the part stands is compared by itself."""
FIGURE = "learned_from"  #: Figure of a run: how many before it, each learned from the one before


def check_learning(scenario: Scenario, controller: Controller) -> None:
    """Refuse a controller that cannot learn, and a run that cannot be learned from.

    Raises:
        InputError: Saying which and what to do.
    """
    if callable(getattr(controller, "prepare", None)):
        raise InputError(
            f"--learn is not for {scenario.controller.label}: it prepares for the path itself and turns the "
            "tool by what it feels, so that its depths do not repeat. Take hybrid-pi, or a law of your own "
            "without prepare()."
        )
    record = read_record(Path(scenario.process.learn))
    if "host_depth_m" not in record.log.columns or record.path is None:
        raise InputError(
            f"nothing can be learned from '{scenario.process.learn}': it is no run of 'surface', or one of "
            "an older version."
        )


def read_lesson(scenario: Checked, path: ToolPath, reach: Reach) -> Lesson:
    """Read what the run ``process.learn`` learned about this path on this part.

    Raises:
        InputError: The folder is no run, or one of another path, place, part, arm, seed or setting.
    """
    from scipy.signal import butter, sosfiltfilt  # slow to import

    folder = scenario.process.learn
    record = read_record(Path(folder))
    keys, before = differences([record.scenario, scenario]), record.path
    other = [key for key in keys if key.partition(".")[0] in SAME and key not in FREE]
    other += [] if record.scenario.seed == scenario.seed else ["seed"]
    if (
        before is None
        or before.positions_work.shape != path.positions_work.shape
        or not np.allclose(before.positions_work, path.positions_work, atol=1e-9)
    ):
        other.insert(0, "the path")
    if not np.allclose(record.metrics["T_base_work"], reach.T_base_work, atol=1e-9):
        other.append("where the part stands")
    if other:
        raise InputError(
            f"the run '{folder}' differs from this one in {', '.join(other[:4])}: what it learned holds for "
            f"the same job alone. Repeat it with --config {Path(folder) / 'config.toml'}, its own --path if "
            "it had one, and --learn."
        )
    beliefs = scenario.controller.adaptive
    time, s = (numbers(record.log, name) for name in ("time_s", "path_s_m"))
    wanted = path.force_at(s, scenario.process.contact_force_n)
    reading = numbers(record.log, "wrench_measured_tool")[:, 2]
    height = numbers(record.log, "host_depth_m") + (wanted - reading) / beliefs.stiffness_n_m
    rate = 1.0 / np.median(np.diff(time))
    highest = math.sqrt(beliefs.stiffness_n_m / beliefs.tool_mass_kg) / (2.0 * math.pi)
    low = butter(2, min(highest, 0.2 * rate), fs=rate, output="sos")
    places = np.arange(0.0, float(path.s[-1]), SPACING)
    slope = np.zeros(len(places))
    ends = np.flatnonzero(np.diff(np.concatenate([[False], record.log.fed, [False]])))
    for first, last in ends.reshape(-1, 2):
        if last - first < SHORTEST_S * rate:
            continue
        at, rows = np.unique(s[first:last], return_index=True)
        learned = sosfiltfilt(low, height[first:last])[rows]
        inside = (places >= at[0]) & (places <= at[-1])
        if inside.sum() > 1:
            slope[inside] = np.gradient(np.interp(places[inside], at, learned), SPACING)
    runs = int(record.metrics.get(FIGURE, 0)) + 1
    return Lesson(slope, SPACING, beliefs.command_delay_s, runs)
