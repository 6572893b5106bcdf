"""Logs as a user might bring them, made from a robot of which everything is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.fourier import FourierMotion, started_and_stopped
from polish_sim.identification.log_file import log_columns
from polish_sim.identification.regressor import States, TorqueModel

Array = NDArray[np.float64]
RATE = 250.0


def write_log(
    file: Path, model: TorqueModel, states: States, sigma: float | Array = 0.0, truth: Array | None = None,
    seed: int = 0,
) -> Path:  # fmt: skip
    """Write states and their torques, with noise, as a log at `RATE`; ``truth`` (p,) if it is not the model's own."""
    torque = model.torque(states, model.truth() if truth is None else truth)
    torque = torque + np.random.default_rng(seed).normal(size=torque.shape) * sigma
    q, force = log_columns(model.chain.geometry.kind.tolist())
    table = np.column_stack([np.arange(len(torque)) / RATE, states.q, torque])
    np.savetxt(file, table, delimiter=",", header=",".join(["time_s", *q, *force]), comments="", fmt="%.9g")
    return file


def played(motion: FourierMotion, periods: int) -> States:
    """A periodic motion entered and left at rest."""
    end = periods * motion.period + 4.0
    return started_and_stopped(motion, np.arange(round(end * RATE)) / RATE, 2.0, end)


def slow_passes(start: Array, seconds: float = 60.0) -> States:
    """Every joint goes to and fro at 0.1 rad/s, each at its own beat, from and to rest."""
    t = np.arange(round(seconds * RATE)) / RATE
    beat = 2.0 * np.pi / (14.0 + 2.3 * np.arange(len(start)))
    gate = np.clip(np.minimum(t, t[-1] - t), 0.0, 1.0)[:, None]
    gate = gate**3 * (10.0 - 15.0 * gate + 6.0 * gate**2)
    speed = 0.1 * gate * np.tanh(15.0 * np.sin(np.outer(t, beat)))
    q = start + np.cumsum(speed, axis=0) / RATE
    return States(q, speed, np.gradient(speed, 1.0 / RATE, axis=0))


def joined(*parts: States) -> States:
    """Parts one after the other, each from and to rest, with a smooth way of three seconds between them."""
    pieces = [parts[0]]
    for part in parts[1:]:
        x = np.arange(1.0, 3.0 * RATE)[:, None] / (3.0 * RATE)
        way = part.q[0] - pieces[-1].q[-1]
        pieces += [
            States(
                pieces[-1].q[-1] + way * x**3 * (10.0 - 15.0 * x + 6.0 * x**2),
                way / 3.0 * 30.0 * x**2 * (1.0 - x) ** 2,
                way / 9.0 * 60.0 * x * (1.0 - 3.0 * x + 2.0 * x**2),
            ),
            part,
        ]  # fmt: skip
    return States(*(np.concatenate(part) for part in zip(*pieces, strict=True)))
