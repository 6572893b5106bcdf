"""A measured active flange beside the simulated one: landing, and the way along two profiles.

The flange of Gadringer, Gattringer and Mueller (2022), an ACF-K 109/04 on a UR10e under position control. Its
moved mass is published. Stroke and start force are assumed. Air, loop, friction and contact are fitted on
`ONE_CURVE` by `fit_rows`, all else is computed with them.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import trimesh

from benchmarks.table import Row
from polish_sim.arrays import Array
from polish_sim.cell import no_part
from polish_sim.compare.figures import BAND_N, ForceStep, from_contact
from polish_sim.config import Scenario
from polish_sim.errors import PlanError
from polish_sim.exchange.robot_log import read_robot_recording
from polish_sim.experiments import default_scenario
from polish_sim.experiments.assembly import Workplace, build_cell, build_part
from polish_sim.experiments.part_pose import PartPlacing
from polish_sim.experiments.part_setup import real_shape
from polish_sim.geometry import fit_surface, select_region
from polish_sim.log import Trace
from polish_sim.planning.part_plan import load_mesh
from polish_sim.planning.toolpath import APPROACH, PROCESS, ToolPath
from polish_sim.scenario_file import override

MASS_KG: Final = 3.38  #: Moved by the flange, as published
STROKE_M: Final = 0.034  #: Assumed
RATE_S: Final = 0.004  #: Of the published curves
HOLD_S: Final = 4.1  #: From contact to the beginning of the travel, by the curves
LANDED_S: Final = {"straight": 3.0, "ramp": 3.0, "contact": 5.0}


class FlangeRig(NamedTuple):
    """What was fitted."""

    bandwidth_hz: float
    stiffness: float  #: Of the air [N/m]
    damping: float  #: [N s/m]
    friction: float  #: [N]
    contact: float  #: Stiffness of roller and part [N/m]
    loss: float  #: Hunt-Crossley factor of that [s/m]


class FlangeCase(NamedTuple):
    """One of the published runs."""

    profile: str
    force: float  #: [N]
    ramp: float  #: [s]
    speed: float  #: Of the path, on ramp and contact test of the approach too [m/s]

    @property
    def name(self) -> str:
        """As the data name it."""
        return f"acf_{self.force:.0f}N_ramp{self.ramp:.1f}_v{self.speed:.2f}"

    @property
    def approach(self) -> float:
        """[m/s]."""
        return 0.25 if self.profile == "straight" else self.speed


ONE_CURVE: Final = FlangeCase("straight", 35.0, 0.0, 0.10)
RIG: Final = FlangeRig(40.0, 8500.0, 47.0, 1.2, 4.9e5, 0.79)
CASES: Final = (
    *(FlangeCase("straight", F, 0.0, v) for v in (0.10, 0.25, 0.90) for F in (15.0, 35.0, 55.0)),
    *(FlangeCase("ramp", F, 0.0, v) for v in (0.10, 0.25) for F in (15.0, 35.0, 55.0)),
    *(FlangeCase("contact", 100.0, ramp, v) for v in (0.10, 0.25) for ramp in (0.0, 0.1)),
)


class ForceFigures(NamedTuple):
    """Of a force beside the one asked for: the size of what is off."""

    settled_s: float  #: From when on it stays within `BAND_N`
    largest_n: float
    mean_n: float
    sd_n: float


def figures_of(time: Array, force: Array, asked: float) -> ForceFigures:
    """Of times from 0 on, shape (n,) [s]."""
    off = np.abs(force - asked)
    outside = np.flatnonzero(off > BAND_N)
    settled = float(time[outside[-1]]) if len(outside) else 0.0
    return ForceFigures(settled, float(off.max()), float(off.mean()), float(off.std()))


def scenario_of(case: FlangeCase, rig: FlangeRig, experiment: str, approach: float) -> Scenario:
    """The measured set-up: an arm under position control, no guard in the way."""
    flange = {
        "bandwidth_hz": rig.bandwidth_hz,
        "friction_n": rig.friction,
        "start_force_n": 10.0 if case.ramp else 0.0,
        "ramp_s": case.ramp,
        "weight_error": 0.0,
    }
    scenario = override(
        default_scenario(experiment),
        [
            *("robot.arm=ur10e", "controller.name=position", "spindle.speed_rpm=0"),
            *("part.displacement_m=0", "part.rotation_rad=0", "part.form_error_m=0"),
            *("safety.force_limit_n=2000", "safety.jump_limit_n=0", "safety.offset_limit_m=0.2"),
            *("safety.torque_limit_nm=1e3", "safety.contact_lost_s=1e5", "safety.stroke_margin=0"),
            *("sensor.force_range_n=1e5", "sensor.torque_range_nm=1e4", "simulation.log_rate_hz=1000"),
            *("pad.radius_m=0.005", f"pad.stiffness_n_m={rig.contact}", f"pad.damping_s_m={rig.loss}"),
            f"robot.linear_acceleration_m_s2={2.0 if experiment == 'force' else 9.0}",
            f"robot.joint_speed_limit_rad_s={math.pi}",
            f"process.contact_force_n={case.force}",
            f"process.approach_speed_m_s={approach}",
            *(f"head.flange.{name}={value}" for name, value in flange.items()),
            *(f"head.stiffness_n_m={rig.stiffness}", f"head.damping_n_s_m={rig.damping}"),
            *(f"head.mass_kg={MASS_KG}", f"head.travel_m={STROKE_M}"),
        ],
    )
    # Faster than a polishing feed may be.
    return replace(scenario, process=replace(scenario.process, feed_m_s=case.speed))


def published(force: Array) -> Array:
    """A force of every millisecond at the rate of the published curves."""
    steps = round(RATE_S / 0.001)
    return np.asarray(force[: len(force) // steps * steps].reshape(-1, steps).mean(axis=1))


def simulated_landing(case: FlangeCase, rig: FlangeRig = RIG) -> ForceFigures:
    """Landing on a bar and the hold after it."""
    window = LANDED_S[case.profile]
    scenario = scenario_of(case, rig, "force", case.approach)
    force = _run(override(scenario, [f"process.hold_s={window}"]), "contact").normal_force_n
    touched = int(np.argmax(force > 0.0))
    force = published(force[touched : touched + round(window / 0.001)])
    return figures_of(RATE_S * np.arange(len(force)), force, case.force)


def simulated_way(case: FlangeCase, rig: FlangeRig = RIG) -> ForceFigures:
    """Along a profile, after a gentle landing."""
    trace = _run(scenario_of(case, rig, "surface", 0.02), case.profile)
    force = published(trace.normal_force_n[trace.fed])
    return figures_of(RATE_S * np.arange(len(force)), force, case.force)


def _run(scenario: Scenario, profile: str) -> Trace:
    """What happened along the profile."""
    place = _place(profile)
    part = build_part(scenario, place)._replace(coarse=no_part().coarse)  # the real tool's shape is not known
    run = build_cell(scenario, place, part).run()
    if run.stop_reason:
        raise PlanError(run.stop_reason)
    return run.trace


@cache
def _place(profile: str) -> Workplace:
    """The part with this profile before the robot, and the path along it."""
    path, shape = PROFILES[profile]()
    scenario = scenario_of(ONE_CURVE, RIG, "surface", 0.02)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "profile.stl"
        shape.apply_scale(1e3).export(file)
        scenario = override(scenario, [f"part.file={file}", "part.unit=mm", "part.up=z"])
        mesh = load_mesh(scenario.part)
    surface = fit_surface(mesh, scenario.plan.feature_angle_rad)
    region = select_region(surface, mesh, "auto", scenario.plan.feature_angle_rad)
    reach = PartPlacing(scenario, mesh, surface, path).reach()
    shape = real_shape(scenario.part, scenario.plan.feature_angle_rad, mesh, surface, path)
    return Workplace(mesh, surface, region, path, reach, shape)


def measured(data: Path, case: FlangeCase) -> tuple[ForceFigures, ForceFigures | None]:
    """Of the published curve: landing, and the way along the profile."""
    log = read_robot_recording(data / f"force_mode_{case.profile}.npz", ("force_n",), run=case.name)
    force = log.values["force_n"][:, 0]
    step = from_contact(log.time, force, case.force)
    window = LANDED_S[case.profile]
    landing = figures_of(*_between(step, 0.0, window), case.force)
    if case.profile == "contact":
        return landing, None
    return landing, figures_of(*_between(step, HOLD_S, HOLD_S + travel_time(case)), case.force)


def _between(step: ForceStep, start: float, end: float) -> tuple[Array, Array]:
    inside = (step.time >= start) & (step.time <= end)
    return step.time[inside] - start, step.force[inside]


def travel_time(case: FlangeCase) -> float:
    """Of the programmed path [s]."""
    acceleration = 9.0 if case.profile == "straight" else 0.7
    length = 0.53 if case.profile == "straight" else float(ramp()[0].s[-1])
    return length / case.speed + case.speed / acceleration


# The two profiles: height of the part and of the programmed path over the way along it.

ARCS: Final = (  # (end [m], radius [m], bend: -1 down, 1 up) of the sheet, and of the path beyond its edge
    *((0.020, math.inf, 1.0), (0.14222, 0.2, -1.0), (0.295, 0.25, 1.0), (0.3425, 0.1, 1.0)),
    *((0.390, 0.1, -1.0), (0.4375, 0.1, -1.0), (0.485, 0.1, 1.0), (0.495, math.inf, 1.0)),
)
EDGE_M: Final = 0.390
BOTTOM_M: Final = -0.0938


def arcs_at(x: Array) -> tuple[Array, Array]:
    """Height [m] and slope angle [rad] of the arcs at places (n,) [m]."""
    height, angle = np.zeros_like(x), np.zeros_like(x)
    start = z = turned = 0.0
    for end, radius, bend in ARCS:
        here = np.append(np.minimum(x, end), end)
        now = np.arcsin(np.clip(np.sin(turned) + bend * (here - start) / radius, -1.0, 1.0))
        level = z + (0.0 * now if math.isinf(radius) else bend * radius * (math.cos(turned) - np.cos(now)))
        beyond = x >= start
        height[beyond], angle[beyond] = level[:-1][beyond], now[:-1][beyond]
        start, z, turned = end, float(level[-1]), float(now[-1])
    return height, angle


def _path(x: Array, z: Array, angle: Array, run_up: float = 0.01) -> ToolPath:
    points = np.column_stack([x, np.zeros_like(x), z])
    axes = np.column_stack([-np.sin(angle), np.zeros_like(x), np.cos(angle)])
    lead = points[:1] + run_up * axes[:1]
    positions, axes = np.concatenate([lead, points]), np.concatenate([axes[:1], axes])
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    kinds = np.full(len(s), PROCESS, np.int8)
    kinds[0] = APPROACH
    return ToolPath(positions, axes, s, np.zeros(len(s), np.int64), kinds, np.zeros(len(s)))


def straight() -> tuple[ToolPath, trimesh.Trimesh]:
    """0.53 m along a bar."""
    x = np.linspace(0.02, 0.55, 266)
    return _path(x, np.zeros_like(x), np.zeros_like(x)), bar(*BAR)


def contact() -> tuple[ToolPath, trimesh.Trimesh]:
    """Straight down onto it."""
    return _path(np.array([0.285]), np.zeros(1), np.zeros(1), RUN_UP_M), bar(*BAR)


def ramp() -> tuple[ToolPath, trimesh.Trimesh]:
    """Along the sheet, and down beyond its edge with the tool upright."""
    x = np.arange(0.010, 0.4951, 0.0025)
    z, angle = arcs_at(x)
    path = _path(x, z, np.where(x > EDGE_M + 1e-9, 0.0, angle))
    x = np.concatenate([np.arange(0.0, EDGE_M, 0.002), [EDGE_M, EDGE_M + 1e-5, 0.5]])
    return path, bar(x, np.where(x <= EDGE_M, arcs_at(x)[0], BOTTOM_M), -0.13)


PROFILES: Final = {"straight": straight, "contact": contact, "ramp": ramp}
RUN_UP_M: Final = 0.07  #: Of the approach, on which the arm comes up to speed
BAR: Final = (np.array([0.0, 0.57]), np.zeros(2), -0.03)  #: Along it, height, underside [m]


def bar(x: Array, z: Array, bottom: float) -> trimesh.Trimesh:
    """A bar of 140 mm with this height along it, shape (n,) [m]."""
    n = len(x)
    rings = [np.column_stack([x, np.full(n, y), h]) for y in (-0.07, 0.07) for h in (z, np.full(n, bottom))]
    front_top, front_low, back_top, back_low = (n * k + np.arange(n) for k in range(4))
    faces: list[Array] = []
    for a, b in ((front_top, back_top), (back_top, back_low), (back_low, front_low), (front_low, front_top)):
        faces += [np.column_stack([a[:-1], a[1:], b[:-1]]), np.column_stack([b[:-1], a[1:], b[1:]])]
    ends = [(front_top[0], back_top[0], back_low[0], front_low[0])]
    ends += [(front_top[-1], front_low[-1], back_low[-1], back_top[-1])]
    faces += [np.array([[p, q, r], [p, r, s]]) for p, q, r, s in ends]
    mesh = trimesh.Trimesh(np.concatenate(rings), np.concatenate(faces))
    trimesh.repair.fix_normals(mesh)
    return mesh


def flange_rows(data: Path) -> Iterator[Row]:
    """Each case: settling, and largest, mean and standard deviation of |dF|, simulated and measured."""
    for case in CASES:
        name = f"{case.profile} {case.force:.0f} N, ramp {case.ramp:g} s, {case.speed:g} m/s"
        landing, way = measured(data, case)
        yield Row(f"{name}: landing", _text(simulated_landing(case), True), _text(landing, True))
        if way is not None:
            yield Row("  along it", _text(simulated_way(case), False), _text(way, False))


def _text(found: ForceFigures, settles: bool) -> str:
    settled, *rest = found
    return " / ".join([*([f"{settled:.2f}"] if settles else []), *(f"{value:.1f}" for value in rest)])


def fit_rows(data: Path, draws: int = 160) -> Iterator[Row]:
    """The rig whose landing is nearest to the curve's, of rigs drawn evenly on logarithmic scales."""
    rng, theirs, best = np.random.default_rng(0), measured(data, ONE_CURVE)[0], (math.inf, RIG)
    low = np.log([5.0, 3e3, 3.0, 0.5, 5e4, 0.1])
    high = np.log([45.0, 2e4, 60.0, 6.0, 1e6, 1.5])
    for _ in range(draws):
        rig = FlangeRig(*(float(f"{value:.2g}") for value in np.exp(rng.uniform(low, high))))
        ours = simulated_landing(ONE_CURVE, rig)
        off = float(np.sqrt(np.mean(np.log(np.add(ours, 0.01) / np.add(theirs, 0.01)) ** 2)))
        best = min(best, (off, rig))
        yield Row(
            " ".join(f"{value:g}" for value in rig), f"{_text(ours, True)}: {off:.2f}", _text(theirs, True)
        )
    yield Row("nearest", " ".join(f"{value:g}" for value in best[1]), "-")
