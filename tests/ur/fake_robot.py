"""A robot without mass for tests of the language: it is at once where it is sent, and notes its calls."""

from typing import Any

import numpy as np

from polish_sim.arrays import Array

MOVE_STEPS = 3


class FakeRobot:
    def __init__(self) -> None:
        self.time_s = 0.0
        self.actual_q = self.target_q = np.array([0.1, -1.5, 1.5, -1.5, -1.5, 0.2])
        self.actual_qd = self.target_qd = self.target_qdd = np.zeros(6)
        self.actual_tcp_pose = self.target_tcp_pose = np.array([0.4, 0.1, 0.3, 0.0, 3.0, 0.0])
        self.actual_tcp_speed = self.target_tcp_speed = np.zeros(6)
        self.tcp_force = np.array([0.0, 0.0, -3.0, 0.0, 0.0, 0.0])
        self.joint_torques = self.free_torques = self.tcp_offset = np.zeros(6)
        self.payload_mass, self.payload_cog, self.payload_inertia = 1.0, np.zeros(3), np.zeros(6)
        self.speed_fraction = 1.0
        self.signals: dict[tuple[str, int], float] = {}
        self.told: list[tuple[Any, ...]] = []
        self._left = 0

    def step(self) -> None:
        self.time_s += 0.002
        self._left -= 1

    def move_done(self) -> bool:
        return self._left <= 0

    def steady(self) -> bool:
        return True

    def read(self, name: str, index: int) -> float:
        return self.signals.get((name, index), 0)

    def write(self, name: str, index: int, value: float) -> None:
        self.signals[name, index] = value

    def forward_kin(self, q: Array, tcp: Array) -> Array:
        return np.asarray(q) / 10.0

    def inverse_kin(self, x: Array, qnear: Array, tcp: Array) -> Array | None:
        return None if np.linalg.norm(x[:3]) > 1.0 else np.asarray(x) * 10.0

    def mass_matrix(self, pos: Array) -> Array:
        return 2.0 * np.eye(6)

    def __getattr__(self, name: str) -> Any:
        def note(*values: Any, **named: Any) -> None:
            self.told.append((name, *(np.asarray(value).tolist() for value in (*values, *named.values()))))
            if name in ("movej", "movel", "movec"):
                self._left = MOVE_STEPS

        return note

    def names(self) -> list[str]:
        return [entry[0] for entry in self.told]


class Notes:
    """What a programme says, and what else its listener is called with."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.events: list[tuple[Any, ...]] = []

    def text(self, text: str) -> None:
        self.texts.append(text)

    def runtime_exception(self, line: int, column: int, text: str) -> None:
        self.events.append(("exception", line, column, text))

    def __getattr__(self, name: str) -> Any:
        return lambda *values: self.events.append((name, *values))
