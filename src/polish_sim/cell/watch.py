"""The guards at work: the first condition that is met, at every step.

They stand beside the controller, not in it: they go on when it fails. They know what a cell knows: the sensor's
reading, the encoders, the plan, the age of the last command, the spindle's speed.
"""

from __future__ import annotations

import math

from polish_sim.cell.carrier import HALTED, SILENCE
from polish_sim.cell.contact import SPIN, RealPart
from polish_sim.cell.guards import (
    CRASH,
    DEPTH,
    FALLEN,
    FOLLOW_S,
    FORCE,
    FROZEN,
    HELD,
    HELD_S,
    HIGH,
    JUMP,
    LOST,
    LOW,
    MASTER_HALTED,
    MASTER_SILENT,
    NO_READING,
    RISEN,
    SILENT_HOST,
    SINGULAR,
    SPINDLE,
    SPINDLE_SHARE,
    TORQUE,
    WAS_HELD,
    Guards,
)
from polish_sim.cell.kernel import CellKernel, EngineViews
from polish_sim.cell.speedl import AGE, NUMBER, WEAKEST
from polish_sim.cell.stroke import TARE, TOUCH_DOWN
from polish_sim.cell.wrist_sensor import CHANGED
from polish_sim.control.signals import Measurement, Target
from polish_sim.geometry.field_lookup import field_distance
from polish_sim.kernel_cache import njit

_CRASH_ROUNDS = 16  # the links' points are looked at in turn, all within this many steps
_DEEPEST = 5.0  # the springs may be this much softer than planned before the force is first held [-]


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def check_reading(cell: CellKernel, t: float) -> float:
    """Code of what is wrong with the sensor's reading, 0 if nothing; before the controller sees it."""
    guards, sensor, smooth = cell.guards, cell.sensor_state, cell.guards.smooth
    finite, size, jump = 0.0, 0.0, 0.0
    for i in range(6):
        finite += sensor.reading[i]
        size += abs(sensor.reading[i])
    if not math.isfinite(finite) or size == 0.0:
        return NO_READING
    if t - sensor.clock[CHANGED] > guards.sensor_timeout and t > 2.0 * guards.sensor_timeout:
        return FROZEN
    share = cell.engine.dt / FOLLOW_S if t > 0.0 else 1.0
    for i in range(3):
        smooth[i] += share * (sensor.reading[i] - smooth[i])
        jump += (sensor.reading[i] - smooth[i]) ** 2
    limit = max(guards.jump, 2.0 * cell.sequence.floor[0])
    return JUMP if jump > limit * limit and cell.sequence.stage[0] != TARE else 0.0


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def check_guards(cell: CellKernel, m: Measurement, target: Target, count: int) -> float:
    """Code of the first condition that is met, 0 if none; see ``REASONS``."""
    guards, w, robot = cell.guards, m.wrench, cell.speedl_state
    if math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2) > guards.force:
        return FORCE
    if math.sqrt(w[3] ** 2 + w[4] ** 2 + w[5] ** 2) > guards.torque:
        return TORQUE
    if robot.clock[WEAKEST] < guards.singular_value:
        return SINGULAR
    if robot.request[NUMBER] > 0.0 and robot.clock[AGE] >= cell.speedl.timeout:
        return SILENT_HOST
    if cell.carrier.clock[HALTED] != 0.0:
        return MASTER_HALTED
    if cell.carrier.clock[SILENCE] > guards.master_timeout:
        return MASTER_SILENT
    if cell.job.contact > 0.0 and cell.spindle.state[SPIN] < SPINDLE_SHARE * cell.spindle.commanded:
        return SPINDLE
    moved = _check_surface(cell, m, target)
    if moved != 0.0:
        return moved
    in_process = target.contact[0] > 0.0
    guards.lost[0] = guards.lost[0] + cell.engine.dt if in_process and w[2] < 0.1 * target.force[0] else 0.0
    if guards.lost[0] > guards.contact_lost:
        return LOST
    if _crashed(guards, cell.part, cell.engine, count % _CRASH_ROUNDS):
        return CRASH
    return 0.0


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _check_surface(cell: CellKernel, m: Measurement, target: Target) -> float:
    """Whether the surface is where it was planned: when contact is found, and from then on.

    What the springs give way by is only known once the force is held in the process; from there on the tool's offset
    from the plan is the surface's. Until then the tool may go as deep as springs five times softer than planned need,
    but not above where it found contact.
    """
    guards, held, stage = cell.guards, cell.guards.held, cell.sequence.stage
    if target.contact[0] == 0.0:
        held[HELD] = held[DEPTH] = held[WAS_HELD] = 0.0
        return 0.0
    offset = 0.0
    for i in range(3):
        offset += target.rotation[i, 2] * (m.position[i] - target.position[i])
    # Depth of the tool below the planned surface, which the target is pressed in by the job's depth.
    depth = offset + (cell.sequence.path[2] if stage[0] == TOUCH_DOWN else cell.job.depth)
    if stage[0] == TOUCH_DOWN and stage[1] == 0.0:
        held[HELD], held[DEPTH], held[WAS_HELD] = 0.0, depth, 0.0
        if abs(depth) > guards.offset:
            return LOW if depth > 0.0 else HIGH
    room = guards.offset
    if held[WAS_HELD] == 0.0:
        room += _DEEPEST * cell.job.depth
        holding = stage[0] != TOUCH_DOWN and abs(m.wrench[2] - target.force[0]) < 0.1 * target.force[0]
        held[HELD] = held[HELD] + cell.engine.dt if holding else 0.0
        if held[HELD] >= HELD_S:
            held[DEPTH], held[WAS_HELD] = depth, 1.0
    if depth - held[DEPTH] > room:
        return FALLEN
    return RISEN if depth - held[DEPTH] < -guards.offset else 0.0


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _crashed(guards: Guards, part: RealPart, e: EngineViews, first: int) -> bool:
    """Whether a sample point of the links is in the part; looks at every ``_CRASH_ROUNDS``-th one."""
    near = 0.5 * part.coarse.spacing  # a sheet thinner than the grid is nowhere negative, but never further than this
    P, p0 = part.rotation, part.position
    for i in range(first, guards.points.shape[0], _CRASH_ROUNDS):
        body, p = guards.bodies[i], guards.points[i]
        R = e.xmat[body]
        x = e.xpos[body, 0] + R[0] * p[0] + R[1] * p[1] + R[2] * p[2] - p0[0]
        y = e.xpos[body, 1] + R[3] * p[0] + R[4] * p[1] + R[5] * p[2] - p0[1]
        z = e.xpos[body, 2] + R[6] * p[0] + R[7] * p[1] + R[8] * p[2] - p0[2]
        wx = P[0, 0] * x + P[1, 0] * y + P[2, 0] * z
        wy = P[0, 1] * x + P[1, 1] * y + P[2, 1] * z
        wz = P[0, 2] * x + P[1, 2] * y + P[2, 2] * z
        if field_distance(part.coarse, wx, wy, wz) < near:
            return True
    return False
