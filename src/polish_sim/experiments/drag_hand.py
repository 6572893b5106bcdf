"""A hand that drags the tool along a path, with the wander, tremor and wobble of a person's (layer 9)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt
from scipy.spatial.transform import Rotation, RotationSpline

from polish_sim.cell.hand import HandMotion
from polish_sim.config import DragConfig, HandConfig
from polish_sim.experiments.teach_moves import HELD, HOLD_S, MOVING, RELEASE_S, MoveTable
from polish_sim.planning.toolpath import arc_length

Array = NDArray[np.float64]

TREMOR_HZ: Final = (8.0, 12.0)
"""Where a person's hand trembles [Hz]."""
RAMP_S: Final = 0.8
"""The hand sets off and stops during this time [s]."""


class DragTable(NamedTuple):
    """What the hand does, and what it means to do."""

    table: MoveTable
    meant: HandMotion
    """Without wander, tremor and wobble."""


def drag_table(
    positions: Array, rotations: Array, drag: DragConfig, hand: HandConfig, dt: float, rng: np.random.Generator
) -> DragTable:
    """Where the hand wants the tool at every step.

    Args:
        positions: The path, base frame [m], shape (m, 3), no point twice.
        rotations: Tool frames along it, shape (m, 3, 3).
        drag: Speed and unsteadiness.
        hand: How long it holds still before and after.
        dt: Time step [s].
        rng: Draws the unsteadiness.
    """
    s = arc_length(positions)
    begin = HOLD_S + RELEASE_S + hand.before_s
    end = begin + s[-1] / drag.speed_m_s + RAMP_S
    t: Array = np.arange(round((end + hand.after_s) / dt)) * np.float64(dt)
    way = np.clip(_way(t - begin, s[-1] / drag.speed_m_s) * drag.speed_m_s, 0.0, s[-1])
    points = np.stack([np.interp(way, s, positions[:, k]) for k in range(3)], axis=1)
    turned = RotationSpline(s, Rotation.from_matrix(rotations))(way)
    moving = (t >= begin) & (t < end)
    # The hand's unsteadiness sets in as it sets off, so that the tool starts where the servos hold it.
    steady = np.clip((t - HOLD_S - RELEASE_S) / hand.before_s, 0.0, 1.0)[:, None]
    shake = steady * (
        _noise(rng, len(t), dt, drag.wander_m, 0.0, drag.wander_hz) + _noise(rng, len(t), dt, drag.tremor_m, *TREMOR_HZ)
    )
    wobble = Rotation.from_rotvec(steady * _noise(rng, len(t), dt, drag.wobble_rad, 0.0, drag.wander_hz))
    grip = (t >= HOLD_S).astype(float)
    servos = np.clip((HOLD_S + RELEASE_S - t) / RELEASE_S, 0.0, 1.0)
    meant = _motion(points, turned.as_matrix(), grip, dt)
    wanted = _motion(points + shake, (turned * wobble).as_matrix(), grip, dt)
    return DragTable(MoveTable(wanted, servos, np.where(moving, MOVING, HELD).astype(np.int8)), meant)


def _motion(positions: Array, rotations: Array, grip: Array, dt: float) -> HandMotion:
    return HandMotion(positions, np.gradient(positions, dt, axis=0), np.ascontiguousarray(rotations), grip.copy())


def _way(t: Array, duration: float) -> Array:
    """Way in units of the usual speed: ramps of RAMP_S at both ends, in between one a second."""
    u, v = np.clip(t / RAMP_S, 0.0, 1.0), np.clip((t - duration) / RAMP_S, 0.0, 1.0)
    ramp = RAMP_S * (u**3 - 0.5 * u**4)  # integral of 3 u^2 - 2 u^3
    back = RAMP_S * (v**3 - 0.5 * v**4)
    return np.asarray(ramp + np.clip(t - RAMP_S, 0.0, None) - np.clip(t - duration - RAMP_S, 0.0, None) - back)


def _noise(rng: np.random.Generator, steps: int, dt: float, rms: float, low: float, high: float) -> Array:
    """Band-limited noise of three axes with a given rms, shape (steps, 3)."""
    settle = round(4.0 / max(high - low, 1e-3) / dt)
    nyquist = 0.5 / dt
    band = butter(2, [low / nyquist, high / nyquist] if low else high / nyquist, "band" if low else "low", output="sos")
    noise = sosfilt(band, rng.standard_normal((settle + steps, 3)), axis=0)[settle:]
    return np.asarray(noise * rms / np.maximum(np.sqrt(np.mean(noise**2, axis=0)), 1e-300))
