"""A robot's force on a part beside the simulation's: a step of the force from first contact, measured
alike."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array, rms

TOUCH_N = 2.0  #: Force from which the tool is in contact
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
    touched = np.flatnonzero(force > TOUCH_N)
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
        "mean_error_n": float(np.abs(off).mean()),
        "peak_n": float(step.force[inside].max()),
        "lost_s": float(np.sum(step.force[inside] < _AIR_N) * dt),
        "late_error_n": float(off[late].mean()),
    }


def compare_steps(measured: ForceStep, simulated: ForceStep) -> dict[str, Any]:
    """Both steps' figures, and the rms of the difference of their curves [N]."""
    time = measured.time[(measured.time >= 0.0) & (measured.time <= WINDOW_S)]
    ours = np.interp(time, simulated.time, simulated.force)
    theirs = np.interp(time, measured.time, measured.force)
    own = measure_step(simulated)
    return {
        "force_rms_n": rms(ours - theirs),
        **measure_step(measured),
        **{f"simulated_{name}": value for name, value in own.items()},
    }
