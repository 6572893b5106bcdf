"""What the hand does in `run teach`: holds, moves, holds, lets go (layer 9)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.hand import HandMotion
from polish_sim.config import GuideConfig, HandConfig
from polish_sim.control.hand_guiding import MODES
from polish_sim.errors import unknown_name
from polish_sim.experiments.guided_arm import DIRECTIONS

Array = NDArray[np.float64]

HOLD_S, RELEASE_S = 0.5, 0.3
"""The servos hold the arm this long, then let go during this time [s]."""
FAST_S, SLOW_S = 0.6, 1.0
"""Durations of the hand's move in paper 3's trial [s]."""
HELD, MOVING, OFF = 0, 2, 3
"""Phases of the log: the hand holds still, moves, is off."""


class Move(NamedTuple):
    """One move of the hand in one mode."""

    mode: str
    direction: str
    duration: float
    """[s]"""
    off: float
    """How long the arm is left to itself after it [s]."""

    @property
    def pace(self) -> str:
        """Fast, slow, or the duration; along a path it has none."""
        if math.isnan(self.duration):
            return "path"
        return {FAST_S: "fast", SLOW_S: "slow"}.get(self.duration, f"{self.duration:g}s".replace(".", "p"))


class MoveTable(NamedTuple):
    """A move, one row a step."""

    motion: HandMotion
    servos: Array
    """1 while the servos hold, shape (n,)."""
    phase: NDArray[np.int8]
    """Shape (n,)."""


def moves_of(guide: GuideConfig, hand: HandConfig) -> list[Move]:
    """The moves a scenario asks for; only the last one is followed for long after the hand has let go.

    Raises:
        InputError: There is no such mode or direction; lists the known ones.
    """
    if guide.mode and guide.mode not in MODES:
        raise unknown_name("mode", guide.mode, MODES)
    if guide.direction and guide.direction not in DIRECTIONS:
        raise unknown_name("direction", guide.direction, DIRECTIONS)
    modes = [guide.mode] if guide.mode else list(MODES)
    directions = [guide.direction] if guide.direction else list(DIRECTIONS)
    durations = [guide.duration_s] if guide.duration_s else [FAST_S, SLOW_S]
    moves = [Move(m, d, s, 0.0) for m in modes for d in directions for s in durations]
    # An arm that does not carry itself is not let go.
    return [*moves[:-1], moves[-1]._replace(off=hand.off_s if MODES[moves[-1].mode].gravity else 0.0)]


def minimum_jerk(share: Array) -> tuple[Array, Array]:
    """Way and speed of a minimum-jerk move of unit length and duration at shares of its time, clipped to 0..1."""
    u = np.clip(share, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * u**2 * (1.0 - u) ** 2


def move_table(move: Move, hand: HandConfig, T_base_home: Array, dt: float) -> MoveTable:
    """Where the hand wants the tool at every step of a move, centred on a pose.

    Args:
        move: The move.
        hand: Its length, and how long the hand holds still.
        T_base_home: The pose in the middle, shape (4, 4).
        dt: Time step [s].
    """
    begin = HOLD_S + RELEASE_S + hand.before_s
    end = begin + move.duration + hand.after_s
    t: Array = np.arange(round((end + move.off) / dt)) * np.float64(dt)
    way, speed = minimum_jerk((t - begin) / move.duration)
    along = np.array(DIRECTIONS[move.direction])
    positions = T_base_home[:3, 3] + hand.distance_m * (way - 0.5)[:, None] * along
    velocities = hand.distance_m / move.duration * speed[:, None] * along
    rotations = np.tile(T_base_home[:3, :3], (len(t), 1, 1))
    grip = ((t >= HOLD_S) & (t < end)).astype(float)
    servos = np.clip((HOLD_S + RELEASE_S - t) / RELEASE_S, 0.0, 1.0)
    phase = np.where((t >= begin) & (t < begin + move.duration), MOVING, np.where(t < end, HELD, OFF)).astype(np.int8)
    return MoveTable(HandMotion(positions, velocities, rotations, grip), servos, phase)
