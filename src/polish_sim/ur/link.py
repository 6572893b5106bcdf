"""The line between robot and clients, by the arm's settings: at times nothing passes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from polish_sim.ur.physics import TICK_S

if TYPE_CHECKING:
    from polish_sim.config import RobotConfig

STREAM = 0x4C494E4B  #: Of the random numbers


class Link:
    """What RTDE clients send arrives at the next tick.

    On an arm that is not ideal the line falls silent for ``robot.real.missed_s``, on average every
    ``missed_every_s``: what either side sends meanwhile arrives when that is over.
    """

    def __init__(self, robot: RobotConfig, seed: int) -> None:
        real = robot.real
        self._rng = np.random.default_rng([seed, STREAM])
        self._apart = real.missed_every_s / TICK_S if robot.elastic else 0.0
        self._length = math.ceil(real.missed_s / TICK_S)
        self._coming: deque[Callable[[], None]] = deque()
        self._gap = self._next(0)
        self.silent = False

    def _next(self, tick: int) -> float:
        return tick + 1 + int(self._rng.exponential(self._apart)) if self._apart else math.inf

    def take(self, act: Callable[[], None]) -> None:
        """Take what a client sent; ``act`` is called when it has arrived."""
        self._coming.append(act)

    def advance(self, tick: int) -> None:
        """Let a tick begin: what arrives in it acts."""
        if tick >= self._gap + self._length:
            self._gap = self._next(tick)
        self.silent = tick >= self._gap
        while self._coming and not self.silent:
            self._coming.popleft()()
