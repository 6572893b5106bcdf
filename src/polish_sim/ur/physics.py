"""The cell under a robot's own controller: its loop, with joint set-points in the place of target, law and
speedl."""

from __future__ import annotations

import math
from tempfile import TemporaryFile
from typing import Any
from weakref import finalize

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.arrays import Array
from polish_sim.cell import Cell
from polish_sim.cell.cell import CellRun, Played
from polish_sim.cell.engine import mj_step1
from polish_sim.cell.gears import RealArm
from polish_sim.cell.guards import NO_STOP, REASONS
from polish_sim.cell.kernel import CellKernel
from polish_sim.cell.loop import (
    FIRST_CONTACT_N,
    finish_step,
    is_over,
    press_on_part,
    read_sensor,
    see_as_host,
)
from polish_sim.cell.real_part import move_part
from polish_sim.cell.recorder import Recorder, TraceStep, build_recorder
from polish_sim.cell.scene import STAND_NAMES
from polish_sim.cell.stroke import APPROACH, FEEDING
from polish_sim.cell.wrist_sensor import DRAWS
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Record, Vector6
from polish_sim.log import APPROACH_PHASE, LOG_ROW, PROCESS_PHASE, RETRACT_PHASE, TOUCH_PHASE
from polish_sim.ur.kinematics import TICK_S

SEATED = 0.8  #: Share of the set force from which a client's pad counts as working
LIFTED_S = 1.0  #: A gap in the contact at least so long is a lift [s]
FAR_M = 10.0  #: Below its place a part that is not there is kept [m]


class Order(Record):
    """Set-points of a tick, and what the joints are at its end."""

    begin: Vector6  #: Joint positions at its begin [rad]
    end: Vector6  #: And at its end
    speed: Vector6  #: [rad/s]
    torque: Vector6  #: Of the joints, where they are commanded [N m]
    by_torque: bool
    kp: Vector6  #: Of the servos [N m/rad]
    read: Vector6  #: Joints by the encoders [rad]
    read_speed: Vector6  #: [rad/s]
    felt: Vector6  #: Torques of the motors [N m]


# Without reference counts, as the cell's own loop.
@njit(_nrt=False)
def follow(  # type: ignore[no-untyped-def]
    cell: CellKernel, arm: RealArm, recorder: Recorder, order: Order, draws: Array, steps: int
) -> None:
    """Run the cell for ``steps`` physics steps under an ``order``; ``draws`` as of
    `polish_sim.cell.loop.advance`.

    A joint commanded by torque has its servo's set-point where the servo gives that torque.
    """
    e = cell.engine
    state = cell.state
    recorder.filled.rows = recorder.filled.steps = 0
    for k in range(steps):
        t = state.status.steps * e.dt
        mj_step1(e.model, e.data)
        move_part(state.motion, t, e.dt, cell.part.position)
        press_on_part(cell)
        see_as_host(arm, state, e)
        read_sensor(cell, t, draws[k])
        state.sequence.stage = FEEDING if state.wrench[2] > FIRST_CONTACT_N else APPROACH
        for j in range(6):
            order.read[j] = arm.read[j] if arm.elastic else e.qpos[j]
            order.read_speed[j] = arm.read_speed[j] if arm.elastic else e.qvel[j]
            place = order.begin[j] + (k + 1) / steps * (order.end[j] - order.begin[j])
            speed = order.speed[j]
            if order.by_torque:
                place = order.read[j] + order.torque[j] / order.kp[j]
                speed = order.read_speed[j]
                if arm.elastic:
                    seen = arm.angle[j] if arm.on_link else order.read[j]
                    place = seen + order.torque[j] / order.kp[j]
                    speed = arm.speed[j]
                    arm.set_point[j] = place
                    arm.set_speed[j] = speed
                    arm.correction[j] = -arm.link_rate * (place - arm.read[j]) if arm.on_link else 0.0
            e.ctrl[2 * j] = place
            e.ctrl[2 * j + 1] = speed
        finish_step(cell, arm, None, recorder, t)
        is_over(cell, 0, t)
        for j in range(6):
            order.felt[j] = e.qfrc_actuator[j]


def clear_away(cell: Cell) -> None:
    """Leave the arm with its tool alone: it touches neither part, table nor stand."""
    cell.state.motion.place[2] -= FAR_M
    names = [cell.model.geom(k).name for k in range(cell.model.ngeom)]
    still = np.isin(names, ("table", *STAND_NAMES))
    cell.model.geom_contype[still] = cell.model.geom_conaffinity[still] = 0


class Rig:
    """A cell whose arm follows orders; what happens is recorded to files of no name until `result`.

    The guards that watch a planned stroke are off; those of force, torque, sensor, part and links are the
    robot's safety functions.
    """

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        state = cell.state
        self.steps = max(1, round(TICK_S / cell.kernel.engine.dt))
        cell.begin_stroke(0)
        guards = state.guards
        guards.singular_value = 0.0
        guards.jump = math.inf
        guards.contact_lost = math.inf
        self._force = float(guards.force)
        self._torque = float(guards.torque)
        arm = cell.real_arm
        model = cell.model
        kp = arm.kp if arm.elastic else -model.actuator_biasprm[:6, 1]
        self.order = Order(kp=kp)
        self.recorder = build_recorder(self.steps, cell._every)
        self._status = state.status
        self.files: list[Any] = [TemporaryFile() for _ in range(2)]  # noqa: SIM115 - closed with the rig
        for file in self.files:
            finalize(self, file.close)
        self.recording = False  #: From the first programme on
        self.recorded = 0  #: Steps

    def run(self) -> str:
        """Run the cell for a tick; why the arm stopped itself in it, or nothing."""
        before = self._status.stop
        if self.cell.faults.waiting:
            self.cell.faults.inject_due(self.cell)
        draws = self.cell.rng.standard_normal((self.steps, DRAWS))
        follow(self.cell.kernel, self.cell.real_arm, self.recorder, self.order, draws, self.steps)
        if self.recording:
            filled = self.recorder.filled
            self.files[0].write(self.recorder.rows[: filled.rows].tobytes())
            self.files[1].write(self.recorder.trace[: filled.steps].tobytes())
            self.recorded += int(filled.steps)
        code = self._status.stop
        return REASONS[code] if code != before else ""

    def unlock(self) -> None:
        """Let the arm move again after a stop of its own; see ``watch``."""
        self._status.stop = NO_STOP
        self._status.stop_time = 0.0
        self.watch(False)

    def watch(self, wanted: bool) -> None:
        """Whether force and torque are watched: not while the arm backs off from what stopped it."""
        guards = self.cell.state.guards
        guards.force = self._force if wanted else math.inf
        guards.torque = self._torque if wanted else math.inf

    def near_limit(self) -> bool:
        """Whether force or torque is above its limit."""
        wrench = self.cell.state.measurement.wrench
        return bool(np.linalg.norm(wrench[:3]) > self._force or np.linalg.norm(wrench[3:]) > self._torque)

    def result(self, wall_s: float, points: Array, s: Array, most_s: float = math.inf) -> CellRun:
        """Everything recorded, as the run of a cell.

        The place on the path of each step in contact is that of the nearest of its ``points`` (n, 3) [m],
        base frame, which lie at arc lengths ``s`` (n,) [m]. A client says nothing of what it is about: the
        pad counts as working from when `SEATED` of the set force is first reached to when that is last so,
        before it is lifted for `LIFTED_S` or longer; a shorter gap is lost contact. ``most_s`` after its
        begin the work is over.
        """
        for file in self.files:
            file.seek(0)
        rows = np.fromfile(self.files[0], LOG_ROW)
        trace = np.fromfile(self.files[1], TraceStep.dtype)
        force = trace["normal_force_n"]
        seconds = trace["time_s"]
        pressing = force > FIRST_CONTACT_N
        trace["path_s_m"] = 0.0
        if pressing.any():
            trace["path_s_m"] = s[cKDTree(points).query(trace["tcp_position_m"])[1]]
        trace["phase"] = np.where(pressing, TOUCH_PHASE, APPROACH_PHASE)
        seated = np.flatnonzero(force >= SEATED * self.cell.scenario.process.contact_force_n)
        if len(seated):
            lifts = np.flatnonzero(_lifted(seconds[seated], seconds[pressing]))
            for some in np.split(seated, lifts + 1):
                trace["phase"][some[0] : some[-1] + 1] = PROCESS_PHASE
            trace["phase"][seconds > seconds[seated[0]] + most_s] = RETRACT_PHASE
        at = np.searchsorted(seconds, rows["time_s"] - 1e-9)
        for name in ("path_s_m", "phase"):
            rows[name] = trace[name][np.minimum(at, len(trace) - 1)]
        return self.cell.result([Played(rows, trace)], False, wall_s)


def _lifted(seated: Array, touching: Array) -> NDArray[np.bool_]:
    """Whether the pad was off the part for `LIFTED_S` between each two times (n,) [s] it was seated; shape (n
    - 1,)."""
    gaps = np.diff(touching) >= LIFTED_S
    begins = touching[:-1][gaps]
    ends = touching[1:][gaps]
    return np.searchsorted(begins, seated[1:]) > np.searchsorted(ends, seated[:-1], side="right")
