"""A robot's force on a part beside the simulation's: a step of the force from first contact, measured
alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.config import Scenario
from polish_sim.scenario_file import override

TOUCH_N: Final = 2.0  #: Force from which the tool is in contact
BAND_N: Final = 10.0  #: A force that stays so near what is asked has settled
WINDOW_S: Final = 3.0  #: After first contact, in which a step is looked at
_AIR_N: Final = 0.5


class ForceStep(NamedTuple):
    """A force over the time since first contact."""

    time: Array  #: [s], shape (n,)
    force: Array  #: Pressing positive [N], shape (n,)
    asked: float  #: [N]


def from_contact(time: Array, force: Array, asked: float) -> ForceStep:
    """A step, its time from the first sample in contact on."""
    touched = np.flatnonzero(force > TOUCH_N)
    return ForceStep(time - (time[touched[0]] if len(touched) else time[-1]), force, asked)


def measure_step(step: ForceStep, window: float = WINDOW_S) -> dict[str, float]:
    """Settling, mean and largest error, time in the air after contact, mean of the last third of the
    ``window`` [s].

    The mean error is that of |force - asked| from first contact on.
    """
    inside = (step.time >= 0.0) & (step.time <= window)
    time, off = step.time[inside], step.force[inside] - step.asked
    outside = np.flatnonzero(np.abs(off) > BAND_N)
    settled = float(time[outside[-1]]) if len(outside) else 0.0
    late = time > 2.0 / 3.0 * window
    dt = float(np.median(np.diff(time)))
    return {
        "settling_s": settled if settled < window - 0.1 else float("nan"),
        "mean_error_n": float(np.abs(off).mean()),
        "peak_n": float(step.force[inside].max()),
        "lost_s": float(np.sum(step.force[inside] < _AIR_N) * dt),
        "late_error_n": float(off[late].mean()),
    }


def compare_steps(measured: ForceStep, simulated: ForceStep, window: float = WINDOW_S) -> dict[str, Any]:
    """Both steps' figures, and the rms of the difference of their curves [N]."""
    time = measured.time[(measured.time >= 0.0) & (measured.time <= window)]
    ours = np.interp(time, simulated.time, simulated.force)
    theirs = np.interp(time, measured.time, measured.force)
    own = measure_step(simulated, window)
    return {
        "force_rms_n": float(np.sqrt(np.mean((ours - theirs) ** 2))),
        **measure_step(measured, window),
        **{f"simulated_{name}": value for name, value in own.items()},
    }


class ContactRig(NamedTuple):
    """What a robot presses with, felt at the tool: its arm's mass behind a soft servo, on a stiff part."""

    stiffness: float  #: Of the arm as its force mode lets it yield [N/m]
    damping: float  #: [N s/m]
    mass: float  #: That lands on the part [kg]
    contact: float  #: Stiffness of roller and part [N/m]


RIG_SETTINGS: Final = (
    *("part.file=plate", "part.displacement_m=0", "part.rotation_rad=0", "part.form_error_m=0"),
    *(
        "safety.force_limit_n=1e4",
        "safety.jump_limit_n=0",
        "safety.offset_limit_m=0.2",
        "safety.contact_lost_s=1e5",
    ),
    *(
        "sensor.force_range_n=1e5",
        "sensor.torque_range_nm=1e4",
        "safety.torque_limit_nm=1e3",
        "head.travel_m=0.1",
    ),
    *("pad.damping_s_m=0.3", "robot.linear_acceleration_m_s2=20", "simulation.log_rate_hz=1000"),
)
"""Of `run force`: stiff landings at the speed of a force mode, no guard in the way."""


def on_rig(scenario: Scenario, rig: ContactRig, asked: float, approach: float, *settings: str) -> Scenario:
    """A scenario of `force` on a rig: ``asked`` [N] after an approach [m/s]."""
    own = [f"process.contact_force_n={asked}", f"process.approach_speed_m_s={approach}"]
    spring = [f"head.stiffness_n_m={rig.stiffness}", f"head.damping_n_s_m={rig.damping}"]
    pad = [f"pad.stiffness_n_m={rig.contact}"]
    scenario = override(scenario, [*RIG_SETTINGS, *own, *spring, *pad, *settings])
    # The head stands for the arm's own mass here, more than a head may have.
    return replace(scenario, head=replace(scenario.head, mass_kg=rig.mass))
