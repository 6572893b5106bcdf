"""Figures of measured joints beside simulated ones, and of a step of the force on a part from first contact:
each by the same estimate on both sides."""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import butter, sosfiltfilt

from polish_sim.arrays import Array, Bools, rms
from polish_sim.planning.toolpath import interpolate

RATE_HZ = 100.0  #: Both sides are looked at on this clock
CYCLES = np.arange(20.0, 450.0, 0.1)  #: Of a turn of the joint, looked through for ripple
_HIGH_PASS_HZ = 2.0
_HARDLY = 0.05  #: Deviation by the largest column's below which one says nothing of a delay
MOST_S = 0.1  #: Delays looked at [s]
_CLOCK_S = 1e-3  #: Shifts are tried in steps of it [s]
_SLOW, _FAST = 0.1, 0.9  #: Speeds between which ripple is within the band of a log of 100 Hz [rad/s]
_STILL = 0.02  #: Below it friction is not that of sliding [rad/s]
_PARTS = 10  #: Of a motion, as long as each other
_LEAST = 300  #: Samples of a direction
SPEEDS = np.array([0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3])
"""Bounds between which friction is averaged [rad/s]."""


def delay(time: Array, measured: Array, simulated: Array) -> float:
    """How late what is measured is behind what is simulated [s], columns (n, k), within +-`MOST_S`.

    The shift of the least squared difference, columns in shares of their deviation, those that hardly change
    left out; NaN if none is within.
    """
    t = np.arange(time[0], time[-1], _CLOCK_S)
    count = round(MOST_S / _CLOCK_S)
    scale = measured.std(axis=0)
    moving = scale > _HARDLY * scale.max(initial=0.0)
    if len(t) < 4 * count or not moving.any():
        return float("nan")
    late, early = (interpolate(t, time, side[:, moving] / scale[moving]) for side in (measured, simulated))
    inside = late[count:-count]
    off = [np.mean((inside - early[count - k : len(t) - count - k]) ** 2) for k in range(-count, count + 1)]
    best = int(np.argmin(off))
    if not 0 < best < len(off) - 1:
        return float("nan")
    before, at, after = off[best - 1 : best + 2]
    return float((best - count + 0.5 * (before - after) / (before - 2.0 * at + after)) * _CLOCK_S)


class Ripple(NamedTuple):
    """The strongest line in a joint's torque by its angle."""

    cycles: float  #: Of a turn of the joint; NaN where it hardly moved
    amplitude: float  #: [N m]


def ripple(time: Array, q: Array, qd: Array, torque: Array) -> Ripple:
    """What of a torque (n,) repeats with the joint's angle (n,), mean of both directions."""
    t = np.arange(time[0], time[-1], 1.0 / RATE_HZ)
    angle, speed, value = (np.interp(t, time, x) for x in (q, qd, torque))
    value = sosfiltfilt(butter(3, _HIGH_PASS_HZ, "high", fs=RATE_HZ, output="sos"), value)
    lines = np.zeros(len(CYCLES))
    count = 0
    for sign in (1.0, -1.0):
        moving = (sign * speed > _SLOW) & (np.abs(speed) < _FAST)
        if (n := int(moving.sum())) >= _LEAST:
            waves = np.exp(-1j * np.outer(CYCLES, angle[moving]))
            lines += np.abs(waves @ value[moving]) * 2.0
            count += n
    if not count:
        return Ripple(float("nan"), float("nan"))
    best = int(lines.argmax())
    return Ripple(float(CYCLES[best]), float(lines[best] / count))


def friction_curve(qd: Array, torque: Array, rigid: Array) -> Array:
    """Mean friction of a joint by speed, (k,) of `SPEEDS` [N m]: torque less that without friction, all (n,).

    NaN where there are fewer than 30 samples.
    """
    size = np.abs(qd)
    rubbing = (torque - rigid) * np.sign(qd)
    return np.array([
        rubbing[inside].mean() if (inside := (size > low) & (size <= high)).sum() >= 30 else np.nan
        for low, high in itertools.pairwise(SPEEDS)
    ])  # fmt: skip


class Friction(NamedTuple):
    """Friction of a sliding joint: (coulomb + viscous speed + share |load|) against its speed."""

    coulomb: float  #: [N m]
    viscous: float  #: [N m s/rad]
    driving: float  #: Share of the load while the motor drives [-]
    driven: float  #: While the load drives [-]


def moves_both_ways(qd: Array) -> Bools:
    """Whether joints move both ways, by their speeds (n, ...); one way, a load looks like friction."""
    return np.minimum(qd.max(axis=0), -qd.min(axis=0)) > _STILL


def fit_friction(qd: Array, torque: Array, rigid: Array) -> tuple[Friction, Array]:
    """Fit friction by speed and load to a joint's torque, that without friction given, all (n,).

    Returns:
        The friction, and the standard errors of its four figures, (4,): by the jackknife, each of `_PARTS`
        of the motion left out once, because what a fit leaves of a motion is no noise.
    """
    moving = np.abs(qd) > _STILL
    sign = np.sign(qd[moving])
    speed = np.abs(qd[moving])
    load = rigid[moving]
    drives = load * sign > 0.0
    base = np.column_stack([np.ones(len(sign)), speed, np.abs(load) * drives, np.abs(load) * ~drives])
    rubbing = (torque - rigid)[moving] * sign
    part = np.linspace(0.0, _PARTS, len(sign), endpoint=False).astype(int)
    *without, found = (
        np.linalg.lstsq(base[part != left_out], rubbing[part != left_out], rcond=None)[0]
        for left_out in range(_PARTS + 1)
    )
    return Friction(*found.tolist()), np.std(without, axis=0) * np.sqrt(_PARTS - 1.0)


TOUCH_N = 2.0  #: Force from which the tool is in contact
TOUCH_S = 0.1  #: Its median over this long counts: one noisy sample is no contact
BAND_N = 10.0  #: A force that stays so near what is asked has settled
WINDOW_S = 3.0  #: After first contact, in which a step is looked at
_AIR_N = 0.5


class ForceStep(NamedTuple):
    """A force over the time since first contact."""

    time: Array  #: [s], shape (n,)
    force: Array  #: Pressing positive [N], shape (n,)
    asked: float  #: [N]


def from_contact(time: Array, force: Array, asked: float) -> ForceStep:
    """A step, its time from the first sample in contact on."""
    steady = median_filter(force, 1 + 2 * int(0.5 * TOUCH_S / np.median(np.diff(time))))
    touched = np.flatnonzero(steady > TOUCH_N)
    return ForceStep(time - (time[touched[0]] if len(touched) else time[-1]), force, asked)


def measure_step(step: ForceStep) -> dict[str, float]:
    """Settling, mean and largest error, time in the air after contact, mean of the last third of
    `WINDOW_S`.

    The mean error is that of |force - asked| from first contact on.
    """
    inside = (step.time >= 0.0) & (step.time <= WINDOW_S)
    time = step.time[inside]
    off = step.force[inside] - step.asked
    outside = np.flatnonzero(np.abs(off) > BAND_N)
    settled = float(time[outside[-1]]) if len(outside) else 0.0
    late = time > 2.0 / 3.0 * WINDOW_S
    dt = np.median(np.diff(time))
    return {
        "settling_s": settled if settled < WINDOW_S - 0.1 else float("nan"),
        "mean_error_n": np.abs(off).mean(),
        "peak_n": step.force[inside].max(),
        "lost_s": np.sum(step.force[inside] < _AIR_N) * dt,
        "late_error_n": off[late].mean(),
    }


def compare_steps(measured: ForceStep, simulated: ForceStep) -> dict[str, Any]:
    """Both steps' figures, and the rms of the difference of their curves [N]."""
    time = measured.time[(measured.time >= 0.0) & (measured.time <= WINDOW_S)]
    ours = np.interp(time, simulated.time, simulated.force)
    theirs = np.interp(time, measured.time, measured.force)
    return {
        "force_rms_n": rms(ours - theirs),
        **measure_step(measured),
        **{f"simulated_{name}": value for name, value in measure_step(simulated).items()},
    }
