"""The figures of a scorecard row, from the exact contact force at every step.

Force is the exact contact force along the tool axis (tool frame, pressing positive), never a sensor's
reading. Each definition is stated once, in ``DEFINITIONS``; a figure that is not defined for a run is None.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from polish_sim.analysis.metrics import (
    CONTACT_N,
    first_contact,
    moving_average,
    settling_time,
    time_step,
)
from polish_sim.arrays import Array
from polish_sim.log import RETRACT_PHASE, Trace

STEADY_AFTER_S = 0.5  #: The steady window of a hold begins this long after first contact [s]
#: A moving mean over this keeps how the force follows the part and takes oscillation away [s]
SLOW_S = 0.25
#: Amplitude a stable loop may swing with, as a share of the wanted force [-]
LARGEST_OSCILLATION = 0.1
LEAST_ALLOWED_N = 2.0  #: The amplitude allowed at small forces [N]
LARGEST_GROWTH = 2.0  #: Of the amplitude from the third to the last quarter of the window [-]
QUIET_N = 0.5  #: Growth below this amplitude is noise [N]

DEFINITIONS: Mapping[str, str] = MappingProxyType(
    {
        "force": "exact contact force along the tool axis, in the tool frame, at every physics step; error "
        "= force minus the force wanted at that place",
        "window": "hold cases: from 0.5 s after first contact (force above 0.5 N) to the end of the hold; "
        "path cases: phase 2, from the start of the feed at the first process point to the last",
        "settling_1n_s": "hold cases: from first contact to the moment after which the error stays inside "
        "+-1 N to the end of the hold; null if it never does, and in path cases",
        "overshoot_n": "largest force above the wanted one from first contact to the end of the hold; in "
        "path cases to the start of the feed; 0 if none",
        "rms_error_n": "root mean square of the error in the window",
        "p95_error_n": "95th percentile of the error's magnitude in the window",
        "max_error_n": "largest magnitude of the error in the window",
        "peak_force_n": "largest force from first contact to the retract",
        "largest_force_n": "largest force of the whole run, the retract and what follows a stop included",
        "contact_lost_s": "time with a force of at most 0.5 N between touch-down (phase 2) and the retract",
        "stable": "no protective stop, the job done to its end, no contact lost, and no oscillation: the "
        "force minus its moving mean over 0.25 s has in the last half of the window an amplitude "
        "(rms times sqrt 2) of at most 10% of the wanted force or 2 N, whichever is larger, and "
        "in the last quarter at most twice that of the quarter before it or 0.5 N",
        "duration": "simulated time of the run [s]",
        "mean_error_n": "mean of the error in the window",
        "std_n": "standard deviation of the error in the window",
        "oscillation_n": "the amplitude by which `stable` judges",
        "slowed": "path cases: share of the wanted feed the controller did not drive, ramps included [-]",
        "peaks_error_n": "path cases: mean over the curvature peaks of the path of the largest error within "
        "15 mm",
    }
)
"""What each figure of a row means."""


def measure_score(trace: Trace, wanted: Array, moving: bool, whole: bool) -> dict[str, Any]:
    """Measure a run as ``DEFINITIONS`` says, None where a figure is not defined.

    Args:
        trace: The run.
        wanted: Force wanted at every step [N], shape (n,).
        moving: Whether the tool was fed along a path; else it held one point.
        whole: Whether the run went to its end without a protective stop.
    """
    held = trace.phase < RETRACT_PHASE
    time, force, error = trace.time_s[held], trace.normal_force_n[held], (trace.normal_force_n - wanted)[held]
    fed = trace.fed[held]
    contact = first_contact(force)
    if contact is None:
        return dict.fromkeys(FIGURES) | {"stable": False}
    since = np.arange(len(time)) >= contact
    window = fed if moving else since & (time >= time[contact] + STEADY_AFTER_S)
    landing = since & ~fed if moving else since
    steady = error[window]
    lost = float(np.sum(since & fed & (force <= CONTACT_N)) * time_step(time))
    swing = oscillation(time[window], steady)
    settled = settling_time(time[since], error[since], 1.0) if whole and not moving else math.nan
    figures = {
        "settling_1n_s": settled,
        "overshoot_n": max(0.0, float(error[landing].max())) if landing.any() else math.nan,
        **_errors(steady),
        "peak_force_n": float(force[since].max()),
        "contact_lost_s": lost,
        "oscillation_n": swing[0],
    }
    allowed = max(
        LEAST_ALLOWED_N, LARGEST_OSCILLATION * float(np.median(wanted[held][window])) if len(steady) else 0.0
    )
    calm = swing[0] <= allowed and swing[2] <= max(LARGEST_GROWTH * swing[1], QUIET_N)
    known = {name: None if math.isnan(value) else value for name, value in figures.items()}
    return known | {"stable": bool(whole and lost == 0.0 and calm)}


def oscillation(time: Array, error: Array) -> tuple[float, float, float]:
    """Amplitude of the fast part of an error [N]: over the last half of the window, its third and its last
    quarter.

    NaN where the window is shorter than two moving means; time evenly spaced [s], (n,).
    """
    slow = moving_average(time, error, SLOW_S)
    if len(slow) < 4 or len(slow) <= len(error) // 2:
        return math.nan, math.nan, math.nan
    first = (len(error) - len(slow)) // 2
    fast = error[first : first + len(slow)] - slow
    half, quarter = len(fast) // 2, len(fast) // 4
    return _amplitude(fast[half:]), _amplitude(fast[half:-quarter]), _amplitude(fast[-quarter:])


class Spread(NamedTuple):
    """One figure over several runs; None where it is undefined for one (worst) or for all (mean)."""

    mean: float | None
    worst: float | None


def spread(values: Sequence[float | None]) -> Spread:
    """Mean of the values there are, and the largest if all of them are there."""
    known = [float(value) for value in values if value is not None]
    if not known:
        return Spread(None, None)
    return Spread(sum(known) / len(known), max(known) if len(known) == len(values) else None)


FIGURES = (
    "settling_1n_s",
    "overshoot_n",
    "rms_error_n",
    "p95_error_n",
    "max_error_n",
    "peak_force_n",
    "contact_lost_s",
    "oscillation_n",
    "mean_error_n",
    "std_n",
)
"""What `measure_score` measures beside ``stable``."""


def _errors(error: Array) -> dict[str, float]:
    """Figures of the error in the window."""
    if not len(error):
        return dict.fromkeys(("rms_error_n", "p95_error_n", "max_error_n", "mean_error_n", "std_n"), math.nan)
    size = np.abs(error)
    return {
        "rms_error_n": math.sqrt(float(np.mean(error**2))),
        "p95_error_n": float(np.percentile(size, 95)),
        "max_error_n": float(size.max()),
        "mean_error_n": float(error.mean()),
        "std_n": float(error.std()),
    }


def _amplitude(fast: Array) -> float:
    return math.sqrt(2.0 * float(np.mean(fast**2)))
