"""What identification is worth where the robot is not what the model says.

`python -m benchmarks.identification --unmatched`: the same motion and the same draws of noise, the robot's
torques made with Stribeck friction, a delay, coloured noise or coarse encoders; a fit that knows of none of
it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from polish_sim.identification.estimate import (
    INTERVAL_95,
    BaseParameters,
    Estimate,
    estimate,
    estimate_widened,
    information,
    inverse_of,
    sum_samples,
    torque_error,
)
from polish_sim.identification.excitation import FourierMotion
from polish_sim.identification.log_file import RobotLog, periodic_states
from polish_sim.identification.regressor import SIGN_WIDTH, States, TorqueModel

Array = NDArray[np.float64]

SEEDS = 10
RATE = 1000.0


def covers(found: Estimate, truth: Array) -> NDArray[np.bool_]:
    """Which 95% intervals hold the true value."""
    return np.abs(found.theta - truth) <= INTERVAL_95 * found.std


@dataclass(frozen=True)
class Robot:
    """What the fit does not know of the robot; by default nothing."""

    stribeck: float = 0.0
    """Breakaway friction above Coulomb's, share of it."""
    stribeck_speed: float = 0.2
    """Speed at which a third of that is left [rad/s]."""
    delay_s: float = 0.0
    """Of the torques behind the positions."""
    noise_time_s: float = 0.0
    """Correlation time of the noise, of the same size; 0 is white."""
    encoder_bits: int = 17
    """A turn has two to this power steps."""


CASES = {
    "matched": Robot(),
    "Stribeck, half of Coulomb more": Robot(stribeck=0.5),
    "torques 4 ms late": Robot(delay_s=0.004),
    "noise of 10 ms": Robot(noise_time_s=0.01),
    "encoders of 13 bits": Robot(encoder_bits=13),
    "all four": Robot(stribeck=0.5, delay_s=0.004, noise_time_s=0.01, encoder_bits=13),
}


class Known(NamedTuple):
    """The arm and two motions of it."""

    model: TorqueModel
    base: BaseParameters
    sigma: Array
    fitted: FourierMotion
    held_out: FourierMotion


def unmatched_lines(known: Known) -> Iterator[str]:
    """A Markdown table, line by line."""
    headings = (
        "robot",
        "held out, 1 period",
        "5 periods",
        "error / CRB",
        "intervals, as if white",
        "as found",
        "fc",
        "fv",
        "Ia",
    )
    yield f"| {' | '.join(headings)} |"
    yield "|" + "---|" * len(headings)
    for name, robot in CASES.items():
        one, five = measure(known, robot, 1), measure(known, robot, 5)
        yield (
            f"| {name} | {100 * one.held_out:.3f}% | {100 * five.held_out:.3f}% | {one.over_bound:.2f} | "
            f"{100 * one.covered[0]:.0f}% | {100 * one.covered[1]:.0f}% | "
            + " | ".join(f"{100 * one.off[term]:.2f}%" for term in ("fc", "fv", "Ia"))
            + " |"
        )


class Measured(NamedTuple):
    """Means over the draws."""

    held_out: float
    over_bound: float
    covered: Array
    """Share of 95% intervals that hold: noise taken as white, and as it is; shape (2,)."""
    off: dict[str, float]
    """Rms error of a kind of parameter identified alone / its size."""


def measure(known: Known, robot: Robot, periods: int) -> Measured:
    """Identify the robot from many draws of noise and compare with what is true of it."""
    model, base, truth = known.model, known.base, known.model.truth()
    t = np.arange(round(periods * known.fitted.period * RATE)) / RATE
    moved = known.fitted(t)
    torque = robot_torque(model, robot, known.fitted, t)
    step = 2.0 * np.pi / 2**robot.encoder_bits
    log = RobotLog(t, np.round(moved.q / step) * step, torque)
    states = periodic_states(log, known.fitted.period)
    seconds = np.arange(0.0, known.held_out.period, 0.01)
    other = known.held_out(seconds)
    exact = robot_torque(model, replace(robot, delay_s=0.0), known.held_out, seconds)
    # Near standstill Coulomb's law has no size: as in every other figure only moving joints count.
    exact = np.where(np.abs(other.qd) > 0.1, exact, np.nan)
    true_base = base.combination @ truth
    bound = np.diag(inverse_of(information(sum_samples(model, base, moved, torque), known.sigma)))
    errors, covered, thetas = [], [], []
    for seed in range(SEEDS):
        noise = coloured(np.random.default_rng([11, seed]), torque.shape, robot.noise_time_s) * known.sigma
        measured = torque + noise
        sums = sum_samples(model, base, states, measured)
        found = estimate_widened(model, base, sums, states, measured)
        errors.append(torque_error(model.torque(other, found.theta, base.columns), exact).mean())
        covered.append([covers(estimate(sums), true_base), covers(found, true_base)])
        thetas.append(found.theta)
    off = np.array(thetas) - true_base
    return Measured(
        float(np.mean(errors)), float(np.sqrt(np.mean(off**2 / bound))), np.mean(covered, axis=(0, 2)),
        {kind: _relative(known, off, true_base, kind) for kind in ("fc", "fv", "Ia")},
    )  # fmt: skip


def _relative(known: Known, off: Array, truth: Array, kind: str) -> float:
    rows = [k for k, column in enumerate(known.base.columns) if known.model.names[column].startswith(kind)]
    return float(np.sqrt(np.mean((off[:, rows] / truth[rows]) ** 2)))


def robot_torque(model: TorqueModel, robot: Robot, motion: Callable[[Array], States], t: Array) -> Array:
    """Torques the robot reports at times t [N m], shape (m, n)."""
    states = motion(t - robot.delay_s)
    coulomb = model.chain.frictionloss * np.tanh(states.qd / SIGN_WIDTH)
    more = robot.stribeck * np.exp(-((states.qd / robot.stribeck_speed) ** 2)) * coulomb
    return np.asarray(model.torque(states, model.truth()) + more)


def coloured(rng: np.random.Generator, shape: tuple[int, ...], time: float) -> Array:
    """Noise of unit variance, white or with a correlation that falls with a time constant [s]."""
    white = rng.normal(size=shape)
    if time == 0.0:
        return white
    keep = np.exp(-1.0 / (RATE * time))
    white[0] /= np.sqrt(1.0 - keep**2)
    return np.asarray(lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white, axis=0))
