"""The cell of two robots: the loop of one with a master that carries the part, and the master's own
faults."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.cell import Cell
from polish_sim.cell.contact import RealPart
from polish_sim.cell.engine import EngineViews, mj_step1
from polish_sim.cell.faults import FAULTS, Fault, set_field
from polish_sim.cell.gears import HostArm, RealArm, compensate, hear_joints, host_hears, read_encoders
from polish_sim.cell.guards import REASONS
from polish_sim.cell.kernel import CODES, CellKernel, CellState
from polish_sim.cell.loop import (
    ask_law,
    command,
    finish_step,
    host_is_due,
    is_over,
    moment_at,
    move_target,
    press_on_part,
    read_sensor,
    see_as_host,
    see_tool,
    trip,
)
from polish_sim.cell.real_arm import build_joints
from polish_sim.cell.real_part import move_part
from polish_sim.cell.recorder import Recorder, put
from polish_sim.cell.robot import SENT
from polish_sim.cell.stroke import FEEDING
from polish_sim.dual.carrier import (
    FIRST_CONTROL,
    FIRST_JOINT,
    FOLLOWER,
    FOLLOWER_ARM,
    MASTER_ARM,
    Master,
    MasterRows,
    build_master,
    carry_part,
    carry_target,
    drive_master,
    see_tool_on_part,
)
from polish_sim.kernel_cache import njit
from polish_sim.kernels import add_to, kernel, memory_of, minus, plus_cross, scaled, set_to
from polish_sim.log import LOG_ROW, RunLog, with_column

MASTER_HALTED, MASTER_SILENT = CODES, CODES + 1


SLOW = 0.5

PAIR_FAULTS: Mapping[str, Fault] = MappingProxyType(
    dict(FAULTS)
    | {
        name: Fault(
            text,
            set_field("master.state", field, value),
            lacking="no second robot: it is one of 'run dual'",
        )
        for name, text, field, value in (
            ("master-stop", "the master stops itself, as its own guards would", "halted", True),
            ("master-silent", "the host no longer receives the master's position", "unheard", True),
            ("master-slow", f"the master moves at {SLOW:g} of its speed", "slow", 1.0 - SLOW),
        )
    }
)


class PairCell(Cell):
    """A cell in which the robot with the tool, the follower, works on a part that the master carries; see
    `Cell`.

    ``master`` is how the master moves, ``host_arm`` the follower as the host computes it; then as of `Cell`.
    """

    arm = FOLLOWER
    fault_table = PAIR_FAULTS
    reasons: Mapping[int, str] = MappingProxyType(
        {
            **REASONS,
            MASTER_HALTED: "the master stopped itself: see there why",
            MASTER_SILENT: "no position of the master for longer than safety.master_timeout_s: check master "
            "and line",
        }
    )
    row = np.dtype((np.record, [*LOG_ROW.descr, ("master_q_rad", float, 6)]))

    def __init__(self, master: MasterRows, host_arm: HostArm, *cell: Any) -> None:
        self._rows = master
        self.host_arm = host_arm
        self.master_arm = RealArm()
        super().__init__(*cell)
        self.master = build_master(
            self.model, self.data, master, self.kernel.part, self.scenario.robot, self.scenario.safety
        )

    def _set_joints(self, q_start: Array) -> None:
        super()._set_joints(q_start)
        self.data.qpos[FIRST_JOINT:] = self.data.ctrl[FIRST_CONTROL::2] = self._rows.q[0]

    def _build_real_arm(self, q_start: Array) -> RealArm:
        # The scene is bent by both tables already; of the master's host the loop keeps its own account.
        self.master_arm, follower = (
            build_joints(
                self.scenario.robot.real, self.scenario.seed, self.model, self.data, q, self.host_arm, place
            )
            for q, place in ((self._rows.q[0], MASTER_ARM), (q_start, FOLLOWER_ARM))
        )
        return follower

    def _advance(self, recorder: Recorder, draws: Array, steps: int) -> None:
        arms = self.real_arm, self.master_arm, self.host_arm
        advance_pair(self.kernel, *arms, self.master, recorder, draws, steps)

    def memory(self) -> list[NDArray[Any]]:
        """Those of the cell, and the master's."""
        records = self.master.state, self.master_arm
        return [*super().memory(), *map(memory_of, records), self.master.line]

    def _log(self, rows: NDArray[np.void]) -> RunLog:
        return with_column(super()._log(rows), "master_q_rad", rows["master_q_rad"])


@njit(_nrt=False)
def advance_pair(
    cell: CellKernel, arm: RealArm, other: RealArm, host_arm: HostArm, master: Master,
    recorder: Recorder, draws: Array, steps: int
) -> None:  # fmt: skip
    """Run two robots for at most ``steps`` physics steps, see ``cell.loop.advance``.

    ``arm`` and ``other``: joints of follower and master; ``host_arm`` as in `PairCell`, for rigid ones.
    """
    e = cell.engine
    state = cell.state
    recorder.filled.rows = recorder.filled.steps = 0
    for k in range(steps):
        t = state.status.steps * e.dt
        mj_step1(e.model, e.data)
        _place_part(e, state, cell.part, master, other, t)
        if cell.stroke.contact:
            press_on_part(cell)
            _push_back(e, state, master.state.part_body)
        if arm.elastic:
            see_as_host(arm, state, e)
        else:
            read_encoders(host_arm, e.qpos)
            see_tool(state, host_arm.place, host_arm.turn, host_arm.anchors, host_arm.axes, e.qvel)
        read_sensor(cell, t, draws[k])
        due, waited = host_is_due(arm, state.status, cell.control_every)
        if due:
            move_target(cell, waited, t)
            carry_target(master.state, state.target)
            ask_law(cell, t)
        command(cell, t)
        # The stop reaches both robots at once, by its own line.
        stopping = state.status.stop != 0 and state.stop.stage != SENT
        drive_master(master, state.sequence.stage == FEEDING, stopping, e.dt, e.ctrl)
        if state.status.steps % recorder.every == 0:
            put(recorder.rows[recorder.filled.rows].master_q_rad, e.qpos[FIRST_JOINT:])
        finish_step(cell, arm, other, recorder, t)
        if master.state.halted:
            trip(state.status, MASTER_HALTED, t)
        elif master.state.silence > master.state.timeout:
            trip(state.status, MASTER_SILENT, t)
        if is_over(cell, master.state.part_body, t):
            return


@kernel
def _place_part(  # type: ignore[no-untyped-def]
    e: EngineViews, state: CellState, part: RealPart, master: Master, arm, t: float
) -> None:
    """Place the part for this instant: where the flange that carries it is, and by its own motion."""
    carrier = master.state
    if not arm.elastic:
        carry_part(master, e, part, state.motion, e.qpos[FIRST_JOINT:], e.qvel[FIRST_JOINT:], True)
    else:
        hear_joints(arm, e)
        compensate(arm, carrier.host_arm, e, state.measurement, -1.0)
        heard = host_hears(arm, True, state.status.steps)
        carry_part(master, e, part, state.motion, arm.links, arm.link_speed, heard)
    move_part(state.motion, t, e.dt, part.position)
    away = minus(part.position, e.xpos[carrier.flange_body])
    add_to(state.motion.velocity, plus_cross(carrier.velocity, carrier.turning, away))
    see_tool_on_part(carrier, e, part, state.motion, state.tool_on_part)


@kernel
def _push_back(e: EngineViews, state: CellState, held: int) -> None:
    """The pad's force on the part, applied to the body that is carried."""
    force, applied = scaled(-1.0, state.scratch[1]), e.xfrc_applied[held]
    set_to(applied, force)
    torque = scaled(-1.0, state.scratch[2])
    moment_at(force, torque, e.site_xpos[e.pad_site], e.xipos[held], applied[3:6])
