"""Protective stops: the conditions under which the simulated robot stops itself, checked at every step.

The guards stand beside the controller, not in it: they still act when it fails. They use what a real cell
has: the sensor's reading, the encoders, the plan, the age of the last command, the spindle's speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.cell.contact import RealPart
from polish_sim.cell.engine import EngineViews
from polish_sim.cell.kernel import CellKernel, CellState, CrashPoints, Guards
from polish_sim.cell.stroke import FEEDING, TARE, TOUCH_DOWN, depth_below
from polish_sim.config import SafetyConfig, SensorConfig
from polish_sim.control.loops import low_pass_share
from polish_sim.geometry.field_lookup import CLIPPED, DistanceField, field_distance
from polish_sim.kernels import dot, kernel, matvec, minus, plus
from polish_sim.models import robot_model_path

NO_STOP = 0
FORCE, TORQUE, LOST, FROZEN, SINGULAR, CRASH, MISSING, CONTROLLER_NAN, JOINT_LIMIT, UNSTABLE = range(1, 11)
ENGINE_CONTACT, CONTROLLER_ERROR, NO_READING, JUMP, SILENT_HOST, SPINDLE, HIGH, LOW, RISEN, FALLEN = range(
    11, 21
)
FIXTURE, OVERLOAD, STROKE, DEEP = range(21, 25)
REASONS: Mapping[int, str] = MappingProxyType(
    {
        FORCE: "measured force above safety.force_limit_n: the pad may be on a wall, an edge or something "
        "harder than the part, or moves too fast for the force loop (--edge-margin, --contact-force, "
        "--feed)",
        TORQUE: "measured torque above safety.torque_limit_nm: the pad may press with its rim only (a "
        "smaller --pad-diameter, --edge-margin)",
        LOST: "contact lost for longer than safety.contact_lost_s: the pad may be over an edge or a hole, "
        "or the part gone (--edge-margin, --hole-margin)",
        FROZEN: "wrist sensor reading frozen: no new value within safety.sensor_timeout_s. Check sensor and "
        "line",
        NO_READING: "wrist sensor reading missing: check sensor and line",
        JUMP: "wrist sensor reading jumped by more than safety.jump_limit_n: a shock, a rigid place under "
        "the pad, gears that shake the arm or a fault of the sensor (process.approach_speed_m_s, "
        "--feed, or another limit)",
        OVERLOAD: "wrist sensor overloaded: force and torque on it, the tool's weight included, take more "
        "than sensor.overload of its range (sensor.model with a larger one, a lighter tool, "
        "--contact-force)",
        SINGULAR: "near a singularity of the arm (safety.singular_value_limit): place the part elsewhere "
        "(--part-pose)",
        CRASH: "tool, wrist or forearm ran into the part: it may stand elsewhere than planned "
        "(--part-pose), or its shape is another (--real-part)",
        FIXTURE: "pad, tool, wrist or forearm ran into the fixture: was the path planned with this "
        "--fixture?",
        MISSING: "no contact down to process.search_depth_m below the nominal surface: is the part there? "
        "Check --part-pose and --units",
        HIGH: "the part is higher than planned: contact found more than safety.offset_limit_m above its "
        "surface. Something else may stand there, or the part is displaced: measure it, or raise the "
        "limit",
        LOW: "the part is lower than planned: contact found more than safety.offset_limit_m below its "
        "surface. The part may be displaced or another one: measure it, or raise the limit",
        RISEN: "the surface has risen by more than safety.offset_limit_m: the pad may be on a wall or step "
        "beside the path (--edge-margin, a smaller --pad-diameter), or the reading has drifted "
        "(process.tare)",
        FALLEN: "the surface has fallen away by more than safety.offset_limit_m: the pad may have run over "
        "an edge or into a hole (--edge-margin, --hole-margin, a smaller --pad-diameter), or part "
        "or reading have drifted (process.tare)",
        STROKE: "the active flange is near the end of its stroke (safety.stroke_margin): the part may "
        "lie elsewhere than planned (--part-pose), or the arm does not follow it",
        DEEP: "the pad was pressed in deeper than the part is modelled: it may press with its rim or on an "
        "edge (--edge-margin, --contact-force, a larger pad.stiffness_n_m)",
        SPINDLE: "the spindle is below 80% of its speed: the pad may be jammed, or pressed too hard "
        "(--contact-force, --spindle-rpm)",
        CONTROLLER_NAN: "the controller returned a value that is not finite: check its own settings "
        "(controller.name)",
        CONTROLLER_ERROR: "the controller raised an error",
        SILENT_HOST: "no command from the host for longer than robot.command_timeout_s: check host and line",
        JOINT_LIMIT: "a joint reached the end of its range: place the part elsewhere (--part-pose)",
        UNSTABLE: "the simulation became unstable: set a smaller simulation.timestep_s, or softer springs "
        "and gains",
        ENGINE_CONTACT: "links of the robot touched each other, the table or another robot: place the part "
        "elsewhere (--part-pose)",
    }
)

MEASURED: Mapping[int, str] = MappingProxyType(
    {
        FORCE: "{0:.1f} N",
        TORQUE: "{0:.2f} N m",
        JUMP: "{0:.1f} N",
        OVERLOAD: "{0:.0%} of the range",
        LOST: "{0:.2f} s",
        SINGULAR: "{0:.3f}",
        SILENT_HOST: "{1:.0f} ms",
        SPINDLE: "{0:.0%} of the speed",
        STROKE: "{0:.0%} of the stroke",
        DEEP: "{1:.1f} mm",
        HIGH: "{1:.2f} mm above",
        LOW: "{1:.2f} mm below",
        RISEN: "{1:.2f} mm",
        FALLEN: "{1:.2f} mm",
    }
)
"""Form of the measured value, {0} in SI and {1} in thousandths of it, for the codes that have a limit."""

SHARES: Mapping[str, int] = MappingProxyType(
    {
        "force": FORCE,
        "torque": TORQUE,
        "contact lost": LOST,
        "near a singularity": SINGULAR,
        "reading jumped": JUMP,
        "host silent": SILENT_HOST,
        "spindle too slow": SPINDLE,
        "part too high": HIGH,
        "part too low": LOW,
        "surface risen": RISEN,
        "surface fallen": FALLEN,
        "sensor overloaded": OVERLOAD,
    }
)
"""Guards of which the largest share of their limit is kept."""

FOLLOW_S = 0.002  # the reading is compared with itself, smoothed over this time
SEEN_S = 0.1  # for this long a jump is watched
SUDDEN = 1.5  # times what the reading did just before, a jump must be
REMEMBERED = 0.8  # share of that which is left after each ``SEEN_S``
SPINDLE_SHARE = 0.8  # of the commanded speed, at least
SHAKEN_S = 0.03  # a force that is missing for less is an arm that shakes
HELD_S = 0.1  # the force within a tenth of the wanted one for this long counts as held
_CRASH_ROUNDS = 16  # the links' points are looked at in turn, all within this many steps
_DEEPEST = 5.0  # the springs may be this much softer than planned before the force is first held [-]


class GuardShare(NamedTuple):
    """How near a guard was to its limit."""

    share: float  #: Largest share of the limit that was reached [-]; 1 trips it
    at_m: float  #: Arc length of the path there [m]


def guard_shares(guards: Guards) -> dict[str, GuardShare]:
    """How near each guard of `SHARES` has been to its limit since `forget_shares`, by its name."""
    return {
        name: GuardShare(float(guards.shares[code]), float(guards.places[code]))
        for name, code in SHARES.items()
    }


def forget_shares(guards: Guards) -> None:
    """Begin anew to note the largest shares."""
    guards.shares[:] = guards.places[:] = 0.0


@kernel
def _note(state: CellState, code: int, share: float) -> None:
    """Keep the share of a guard's limit if it is the largest so far."""
    guards = state.guards
    if share > guards.shares[code]:
        guards.shares[code], guards.places[code] = share, state.target.s


@kernel
def _exceeds(state: CellState, code: int, found: float, limit: float) -> bool:
    """Note what a guard has found, with its share of the limit, and whether it is above that."""
    state.guards.found = found
    _note(state, code, found / limit)
    return found > limit


def build_guards(safety: SafetyConfig, sensor: SensorConfig, arm_mode: float, dt: float) -> Guards:
    """Guards with a scenario's limits, of an arm that swings at a frequency [Hz]; ``dt``: of a step [s]."""
    # Without noise a robot at rest reads the same all the time, which is no fault.
    restless = min(sensor.force_noise_n - sensor.force_quantum_n, sensor.torque_noise_nm) > 0.0
    return Guards(
        force=safety.force_limit_n,
        torque=safety.torque_limit_nm,
        contact_lost=safety.contact_lost_s,
        sensor_timeout=safety.sensor_timeout_s if restless else math.inf,
        jump=safety.jump_limit_n or math.inf,
        jump_share=_jump_share(sensor, arm_mode, dt),
        singular_value=safety.singular_value_limit,
        offset=safety.offset_limit_m,
        stroke=0.5 - safety.stroke_margin if safety.stroke_margin else math.inf,
    )


def _jump_share(sensor: SensorConfig, arm_mode: float, dt: float) -> float:
    """How much of a jump [-] the guard sees: a step of one through the sensor, compared with itself smoothed.

    No less than of a swing of one at the arm's mode, so that the arm may swing by as much as the force
    may jump.
    """
    t = np.arange(0.0, SEEN_S, dt)
    swing = np.sin(2.0 * np.pi * arm_mode * t)
    return max(_most_seen(sensor, dt, force) for force in (np.ones_like(t), swing))


def _most_seen(sensor: SensorConfig, dt: float, force: Array) -> float:
    """The largest difference [N] between a reading and itself smoothed, of a ``force`` (n,) that begins at a
    time 0."""
    blend = low_pass_share(sensor.bandwidth_hz, 1.0 / sensor.rate_hz) or 1.0
    reading = smooth = most = due = 0.0
    for k, value in enumerate(force):
        if k * dt >= due:
            due += 1.0 / sensor.rate_hz
            reading += blend * (value - reading)
        smooth += dt / FOLLOW_S * (reading - smooth)
        most = max(most, abs(reading - smooth))
    return most


@kernel
def check_reading(state: CellState, dt: float, t: float) -> int:
    """Code of a fault in the sensor's reading, 0 for none; before the controller sees it."""
    guards, sensor, sequence = state.guards, state.sensor, state.sequence
    reading, smooth = sensor.reading, guards.smooth
    size = jump = 0.0
    for i in range(6):
        size += abs(reading[i])
    if not math.isfinite(size) or size == 0.0:
        return NO_READING
    overload = sensor.errors.overload
    if overload > 0.0 and _exceeds(state, OVERLOAD, sensor.load, overload):
        return OVERLOAD
    if t - sensor.changed > guards.sensor_timeout and t > 2.0 * guards.sensor_timeout:
        return FROZEN
    share = dt / FOLLOW_S if t > 0.0 else 1.0
    for i in range(3):
        smooth[i] += share * (reading[i] - smooth[i])
        jump += (reading[i] - smooth[i]) ** 2
    # An arm that its gears shake swings up over many cycles, a fault does not.
    if t > guards.window:
        guards.window, guards.swung = t + SEEN_S, max(guards.swing, REMEMBERED * guards.swung)
        guards.swing = 0.0
    limit = max(guards.jump, 2.0 * sequence.floor / guards.jump_share, SUDDEN * guards.swung)
    if sequence.stage == TARE:
        return NO_STOP
    found = math.sqrt(jump) / guards.jump_share
    guards.swing = max(guards.swing, found)
    return JUMP if _exceeds(state, JUMP, found, limit) else NO_STOP


@kernel
def check_guards(cell: CellKernel, count: int) -> int:
    """Code of the first condition that is met after ``count`` steps, 0 if none; see ``REASONS``."""
    e, state, crash, fixture = cell.engine, cell.state, cell.crash_points, cell.fixture
    guards = state.guards
    dt = e.dt
    robot = state.speedl
    w = state.measurement.wrench
    target = state.target
    if _exceeds(state, FORCE, math.sqrt(dot(w, w)), guards.force):
        return FORCE
    if _exceeds(state, TORQUE, math.sqrt(dot(w[3:6], w[3:6])), guards.torque):
        return TORQUE
    guards.found = robot.weakest
    _note(state, SINGULAR, guards.singular_value / robot.weakest)
    if robot.weakest < guards.singular_value:
        return SINGULAR
    guards.found = robot.age
    if robot.number > 0:
        _note(state, SILENT_HOST, robot.age / robot.timeout)
        if robot.age >= robot.timeout:
            return SILENT_HOST
    spindle = state.spindle
    if cell.stroke.contact and spindle.commanded > 0.0:
        guards.found = spindle.speed / spindle.commanded
        _note(state, SPINDLE, (1.0 - guards.found) / (1.0 - SPINDLE_SHARE))
        if guards.found < SPINDLE_SHARE:
            return SPINDLE
    flange = state.flange
    if flange.share > 0.0 and state.sequence.stage == FEEDING:
        guards.found = flange.travel / flange.stroke
        if abs(guards.found - 0.5) > guards.stroke:
            return STROKE
    if _exceeds(state, DEEP, guards.pressed, CLIPPED * cell.part.field.band):
        return DEEP
    moved = _check_surface(cell, dt)
    if moved != NO_STOP:
        return moved
    guards.lost = guards.lost + dt if target.contact and w[2] < 0.1 * target.force else 0.0
    if _exceeds(state, LOST, guards.lost, guards.contact_lost):
        return LOST
    first, rim = count % _CRASH_ROUNDS, crash.points.shape[0] - crash.pad
    if _crashed(crash, first, rim, cell.part, cell.part.coarse, e):
        return CRASH
    if fixture.coarse.table.size > 1 and (
        _crashed(crash, first, rim, fixture, fixture.coarse, e)
        or _crashed(crash, rim + first, rim + crash.pad, fixture, fixture.field, e)
    ):
        return FIXTURE
    return NO_STOP


@kernel
def _check_surface(cell: CellKernel, dt: float) -> int:
    """Whether the surface is where it was planned: when contact is found, and from then on.

    How far the springs are pressed in is only known once the force is held in the process; from there on the
    surface is off the plan by the tool's offset and by what the springs gave way since, as they are planned
    (``planned`` under the force wanted): a force that is missing is surface that has gone. Until then the
    tool may go as deep as springs five times softer than planned need, but not above where it found contact.
    A pad that leans finds it with its rim, up to ``stroke.early`` above the surface.
    An active flange measures by its travel where the surface is.
    """
    state, planned = cell.state, cell.stroke.depth
    guards = state.guards
    sequence = state.sequence
    m = state.measurement
    target = state.target
    if not target.contact:
        guards.holding, guards.depth, guards.was_held, guards.missing = 0.0, 0.0, False, 0.0
        return NO_STOP
    offset = depth_below(target, m.position)
    landing = sequence.stage == TOUCH_DOWN
    # Depth of the tool below the planned surface, which the target is pressed in by the stroke's depth.
    depth = offset + (sequence.depth if landing else planned) - state.flange.travel
    if landing and sequence.time == 0.0:
        guards.depth = depth
        code, off = (LOW, depth) if depth > 0.0 else (HIGH, -depth - cell.stroke.early)
        if _exceeds(state, code, off, guards.offset):
            return code
    room = guards.offset
    missing = 1.0 - max(m.wrench[2], 0.0) / target.force
    guards.missing += dt / SHAKEN_S * (missing - guards.missing)
    place = depth if state.flange.share > 0.0 else offset + planned * guards.missing
    if not guards.was_held:
        room += _DEEPEST * planned
        guards.holding = guards.holding + dt if not landing and abs(missing) < 0.1 else 0.0
        if guards.holding >= HELD_S:
            guards.depth = place
            guards.was_held = True
    fallen = (place if guards.was_held else depth) - guards.depth
    if _exceeds(state, FALLEN, fallen, room):
        return FALLEN
    return RISEN if _exceeds(state, RISEN, -fallen, guards.offset) else NO_STOP


@kernel
def _crashed(
    crash: CrashPoints, first: int, end: int, part: RealPart, field: DistanceField, e: EngineViews
) -> bool:
    """Whether a sample point of the links, every ``_CRASH_ROUNDS``-th of some, is in the part by one of its
    fields."""
    # a sheet thinner than the grid is nowhere negative, but never further than this
    near = 0.5 * field.spacing
    for i in range(first, end, _CRASH_ROUNDS):
        body, p = crash.bodies[i], crash.points[i]
        place = plus(e.xpos[body], matvec(e.xmat[body], p))
        x, y, z = matvec(part.rotation.T, minus(place, part.position))
        if field_distance(field, x, y, z) < near:
            return True
    return False


# Sample points on shaft, spindle, sensor, wrist and forearm that must stay out of the part.

BODIES = ("tool_mount", "link_6", "link_5", "link_4", "link_3")
_SHAFT, _PAD = "head_shaft", "head_pad"
_SPACING = 0.03  # one point is kept in each cube of this side [m]
_AROUND, _AROUND_PAD = 12, 32  # points of a ring around the shaft and the pad


def crash_points(model: mujoco.MjModel, arm: str = "") -> CrashPoints:
    """Points spread over the drawn meshes of the links behind the pad, the shaft it turns on, and the pad's
    rim."""
    on_shaft = _on_cylinder(model, model.geom(f"{arm}{_SHAFT}").id)
    points, bodies = [on_shaft], [np.full(len(on_shaft), model.body(f"{arm}head").id)]
    for body in (model.body(arm + name).id for name in BODIES):
        drawn = (model.geom_bodyid == body) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
        for geom in np.flatnonzero(drawn):
            R = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
            mesh = int(model.geom_dataid[geom])
            start = model.mesh_vertadr[mesh]
            spread = R.apply(model.mesh_vert[start : start + model.mesh_vertnum[mesh]]) + model.geom_pos[geom]
            cubes = np.round(spread / _SPACING) @ [1e6, 1e3, 1.0]  # a number for each
            points.append(spread[np.unique(cubes, return_index=True)[1]])
            bodies.append(np.full(len(points[-1]), body))
    rim = _on_cylinder(model, model.geom(f"{arm}{_PAD}").id, _AROUND_PAD)
    points, bodies = [*points, rim], [*bodies, np.full(len(rim), model.body(f"{arm}head").id)]
    return CrashPoints(np.concatenate(points), np.concatenate(bodies).astype(np.int64), len(rim))


def shaft_points() -> Array:
    """Points on the shaft, frame of the tool with the head's spring at rest [m], shape (k, 3)."""
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    return _on_cylinder(model, model.geom(_SHAFT).id)


def _on_cylinder(model: mujoco.MjModel, geom: int, count: int = _AROUND) -> Array:
    """Points around a cylinder from end to end, frame of its body [m], shape (k, 3)."""
    radius, half = model.geom_size[geom, :2]
    around = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    rings = np.linspace(-half, half, int(np.ceil(2.0 * half / _SPACING)) + 1)
    angle, z = (grid.ravel() for grid in np.meshgrid(around, rings))
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    R = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
    return R.apply(points) + model.geom_pos[geom]
