"""From a robot's own motion to its dynamics: regressor, base parameters, excitation, estimation; the settings
of an identification, and what is asked of its figures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

from polish_sim.analysis.claim import Claim
from polish_sim.cell.real_arm import take_arm
from polish_sim.config import RobotConfig, Scenario, SimulationConfig, SpindleConfig
from polish_sim.config.key import key
from polish_sim.scenario_file import checked_value

STEP_S = 2.5e-4  #: Physics step: the engine takes friction half a step late, so it is kept short
SCENARIO = Scenario(
    experiment="identify", robot=RobotConfig(arm="ideal"), spindle=SpindleConfig(speed_rpm=0.0),
    simulation=SimulationConfig(timestep_s=STEP_S),
)  # fmt: skip
"""The arm whose torques are those of the fit: what a log is read by and methods are measured on."""


@dataclass(frozen=True)
class IdentifySettings:
    """Settings of one simulated identification."""

    periods: int = key(5, "periods of 10 s to log", 1, 360)
    rate: float = 1000.0  #: Of the log [Hz]
    #: White noise of the torques [N m], joint by joint
    sigma: tuple[float, ...] = (1.0, 1.0, 1.0, 0.2, 0.2, 0.2)
    encoder: float = 4.8e-5  #: Step of an ideal arm's encoders [rad]: 17 bits a turn
    iterations: int = 300  #: Of the search for an exciting motion
    starts: int = key(1, "random motions that search begins from", 1)
    robot: RobotConfig = RobotConfig()  #: The simulated one
    payload: float = key(0.0, "mass of a payload that is found in a second run, none if 0 [kg]", 0.0, 3.0)
    seed: int = 0

    @property
    def encoder_step(self) -> float:
        """Step of the encoders the robot's positions are logged by [rad]."""
        return self.robot.real.encoder_rad if self.robot.elastic else self.encoder

    def __post_init__(self) -> None:
        take_arm(self.robot)
        for field in fields(self):
            if field.metadata:
                checked_value(field.name, getattr(self, field.name), field.default, field)


def _identify(error: float, predicted: float = 0.0285) -> tuple[Claim, ...]:
    """Claims of an identification; the error on a motion that was not fitted falls with the periods
    logged."""
    return (
        Claim("nrms_heldout_mean", "error held out / range of the torque", "%", high=error),
        Claim("nrms_heldout_consistent_mean", "the same, bodies that can exist", "%"),
        Claim("nrms_heldout_drawing_mean", "the same by the drawing", "%"),
        Claim("physically_consistent", "bodies that can exist", "", low=1.0, more_is_better=True),
        Claim("predicted_error_sigma", "predicted error / noise, one period", "", high=predicted),
        Claim("condition_motion", "condition of the motion, SI units", ""),
        Claim("error_over_crb", "error / Cramér-Rao bound, this draw", ""),
        Claim("interval_coverage", "95% intervals that hold the truth", "%", more_is_better=True),
        Claim("base_parameters", "base parameters", ""),
        Claim("design_s", "design of the motion, CPU", "s"),
        Claim("fit_s", "fit, CPU", "s"),
    )


_IDENTIFY_DATA = (
    Claim("nrms_heldout_mean", "residual held out / range of the torque", "%"),
    Claim("nrms_heldout_drawing_mean", "the same by the drawing", "%"),
    Claim("base_parameters", "base parameters", ""),
    Claim("condition", "condition, SI units", ""),
    Claim("physically_consistent", "bodies that can exist", "", low=1.0, more_is_better=True),
)
ELASTIC = 5e-3  #: Asked of an elastic arm's error held out, in ranges of the torque
GEARS = (
    Claim("gear_slopes_found", "slopes of the gears' stiffness found, of 18", "", more_is_better=True),
    Claim("gear_stiffness_error_max", "  their largest error", "%"),
    Claim("gear_interval_coverage", "  95% intervals that hold the truth", "%", more_is_better=True),
)
"""More of elastic joints."""

IDENTIFY: Mapping[str, tuple[Claim, ...]] = {
    "full": _identify(6e-4),
    "short": _identify(1.3e-3),
    # The bound on the predicted error is for the default task, random motions under the same limits.
    "task": _identify(1.3e-3, math.inf),
    "data": _IDENTIFY_DATA,
    "gears": (
        *_IDENTIFY_DATA,
        Claim("nrms_heldout_rigid_mean", "friction by speed alone: residual / range", "%"),
    ),
}
