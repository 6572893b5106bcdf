"""A noise-free test bench for the force loop: press the tool on a plane and see whether the loop settles."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell import RealPart
from polish_sim.config import Checked, Scenario
from polish_sim.control import Controller, Course, Measurement, Target, build_controller
from polish_sim.experiments.assembly import Workplace, build_cell, build_part, check
from polish_sim.experiments.part_pose import reach_path
from polish_sim.experiments.surface import place_force
from polish_sim.scenario_file import override
from polish_sim.scoring.figures import LARGEST_OSCILLATION, LEAST_ALLOWED_N

# Whether a force loop has settled, and the map of where it does.


AT_REST_N = 0.05  #: Swing of the force, peak to peak, below which the loop is at rest [N]
DYING = 0.9  #: A swing that shrinks by this factor in a window is dying away [-]
WINDOW_S = 0.8


class Rest(NamedTuple):
    """How a loop ended."""

    resting: bool | None  #: No swing, or one that dies away; None: the run's process died
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
    place = replace(place, path=path, reach=reach_path(calm, place.mesh, place.surface, path))
    return Bench(place, build_part(calm, place))


class LouderLaw:
    """A controller whose answer along the tool axis is multiplied while it presses: the loop's gain, at its
    input."""

    def __init__(self, controller: Controller, gain: float) -> None:
        self._controller, self._gain = controller, gain

    def prepare(self, course: Course) -> None:
        """Pass on what lies ahead, to a controller that prepares for it."""
        prepare = getattr(self._controller, "prepare", None)
        if callable(prepare):
            prepare(course)

    def reset(self, cycle_s: float) -> None:
        """Forget everything."""
        self._controller.reset(cycle_s)

    def step(self, measurement: Measurement, target: Target) -> Array:
        """The controller's answer, louder along the tool axis."""
        answer = np.array(self._controller.step(measurement, target))
        if target.contact:
            z = measurement.rotation[:, 2]
            answer[:3] += (self._gain - 1.0) * (z @ answer[:3]) * z
        return answer


def press(bench: Bench, scenario: Scenario, gain: float = 1.0, friction: bool = True) -> Rest:
    """Press on the part, hold, and see whether the force settles; a protective stop counts as unstable.

    Noise and part errors of the scenario are taken out. ``gain``: on the controller's answer along the tool
    axis; ``friction``: Coulomb friction of the joints; without it the loop is linear but for its limits.
    """
    calm = quiet(scenario)
    cell = build_cell(calm, bench.place, bench.part)
    if not friction:
        cell.model.dof_frictionloss[:] = 0.0
    if gain != 1.0:
        cell.use_controller(LouderLaw(build_controller(calm.controller), gain))
    trace = cell.run().trace
    held = trace.normal_force_n[trace.fed]
    whole = len(held) >= round(calm.process.hold_s / calm.simulation.timestep_s) - 1
    return judge_rest(held if whole else held[:0], calm.process.contact_force_n, calm.simulation.timestep_s)
