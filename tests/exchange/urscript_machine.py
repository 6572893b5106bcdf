"""Our robot programs, run by the URScript machine of `serve`, on a robot that is at once where it is sent and
writes down what it was told."""

from typing import NamedTuple

import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.spatial import from_pose
from tests.ur.fake_robot import FakeRobot, Notes

pytest.importorskip("lark")

from polish_sim.ur.script import Machine

MOST_STEPS = 100_000


class Motion(NamedTuple):
    """A move."""

    T_base_tool: Array
    speed: float
    blend: float
    pressing: bool
    spindle: bool


class Pressing(NamedTuple):
    """One call of force_mode."""

    T_base_task: Array
    T_base_tool: Array
    selection: list[float]
    wrench: list[float]
    kind: int
    limits: list[float]


class Recorder(FakeRobot):
    """Its joints are its pose; it feels the force wanted some time after it began to press."""

    def __init__(self, contact_after_s: float) -> None:
        super().__init__()
        self.contact_after_s = contact_after_s
        self.motions: list[Motion] = []
        self.pressings: list[Pressing] = []
        self.pressing_since_s = np.inf
        self.spindle = False

    def step(self) -> None:
        super().step()
        felt = self.time_s - self.pressing_since_s > self.contact_after_s
        self.tcp_force = np.array([0.0, 0.0, self.pressings[-1].wrench[2] if felt else 0.0, 0.0, 0.0, 0.0])

    def forward_kin(self, q: Array, tcp: Array) -> Array:
        return q

    def inverse_kin(self, pose: Array, near: Array, tcp: Array) -> Array:
        return pose

    def movel(self, pose: Array, a: float, v: float, t: float, r: float) -> None:
        self.actual_tcp_pose = pose
        self.motions.append(Motion(from_pose(pose), v, r, False, self.spindle))

    movej = movel

    def force_mode(self, task: Array, selection: Array, wrench: Array, kind: int, limits: Array) -> None:
        if self.pressing_since_s == np.inf:
            self.pressing_since_s = self.time_s
            self.told.append(("force_mode",))
        self.motions[-1] = self.motions[-1]._replace(pressing=True)
        frames = from_pose(task), from_pose(self.actual_tcp_pose)
        self.pressings.append(Pressing(*frames, selection.tolist(), wrench.tolist(), kind, limits.tolist()))

    def end_force_mode(self) -> None:
        if self.pressing_since_s < np.inf:
            self.told.append(("end_force_mode",))
        self.pressing_since_s = np.inf

    def input_output(self, name: str, index: int, value: float | bool | None = None) -> float | bool:
        if value is not None:
            self.spindle = bool(value)
            self.told.append((f"spindle {self.spindle}",))
        return self.spindle


def run_program(text: str, contact_after_s: float = 0.05) -> Recorder:
    """The robot after the program; popups are closed at once."""
    robot, notes = Recorder(contact_after_s), Notes()
    machine = Machine(text, notes)
    for _ in range(MOST_STEPS):
        machine.tick(robot)
        robot.step()
        if machine.popup_open:
            robot.told.append(("popup",))
            machine.close_popup()
        if not machine.running:
            break
    assert not machine.running
    assert "exception" not in [event[0] for event in notes.events], notes.events
    return robot
