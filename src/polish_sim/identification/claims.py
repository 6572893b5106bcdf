"""What is asked of an identification, by what it was made from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from polish_sim.analysis.claim import Claim


def _identify(error: float, predicted: float = 0.0285) -> tuple[Claim, ...]:
    """Claims of an identification; the error on a motion that was not fitted falls with the periods logged."""
    return (
        Claim("nrms_heldout_mean", "error held out / range of the torque", "%", 100.0, "-", high=error),
        Claim("nrms_heldout_consistent_mean", "the same, bodies that can exist", "%", 100.0),
        Claim("nrms_heldout_drawing_mean", "the same by the drawing", "%", 100.0),
        Claim("physically_consistent", "bodies that can exist", "", 1.0, "-", low=1.0, more_is_better=True),
        Claim("predicted_error_sigma", "predicted error / noise, one period", "", 1.0, "-", high=predicted),
        Claim("condition_motion", "condition of the motion, SI units", "", 1.0),
        Claim("error_over_crb", "error / Cramér-Rao bound, this draw", "", 1.0),
        Claim("interval_coverage", "95% intervals that hold the truth", "%", 100.0),
        Claim("base_parameters", "base parameters", "", 1.0),
        Claim("design_s", "design of the motion, CPU", "s", 1.0, "-", high=20.0),
        Claim("fit_s", "fit, CPU", "s", 1.0),
    )


_IDENTIFY_DATA: Final = (
    Claim("nrms_heldout_mean", "residual held out / range of the torque", "%", 100.0),
    Claim("nrms_heldout_drawing_mean", "the same by the drawing", "%", 100.0),
    Claim("base_parameters", "base parameters", "", 1.0),
    Claim("condition", "condition, SI units", "", 1.0),
    Claim("physically_consistent", "bodies that can exist", "", 1.0, low=1.0, more_is_better=True),
)
_STEPWISE: Final = (
    Claim("first_step_parameters", "parameters of the first step", "", 1.0),
    Claim("stepwise_over_joint", "error, stepwise / joint", "", 1.0, "-", high=1.01),
)

IDENTIFY: Final[Mapping[str, tuple[Claim, ...]]] = {
    "full": _identify(6e-4),
    "short": _identify(1.3e-3),
    "stepwise": (*_identify(1.3e-3), *_STEPWISE),
    # The bound on the predicted error is the default objective's, and for the default task, random motions under
    # the same limits.
    "full-other": _identify(6e-4, math.inf),
    "short-other": _identify(1.3e-3, math.inf),
    "stepwise-other": (*_identify(1.3e-3, math.inf), *_STEPWISE),
    "task": _identify(1.3e-3, math.inf),
    "data": _IDENTIFY_DATA,
    "payload-data": (
        Claim("payload_mass_std_kg", "mass, std", "g", 1e3),
        Claim("payload_consistent_as_found", "a body can have these numbers as found", "", 1.0),
        Claim("payload_consistent", "the nearest body can exist", "", 1.0, low=1.0, more_is_better=True),
    ),
    "data-stepwise": (*_IDENTIFY_DATA, *_STEPWISE),
}
