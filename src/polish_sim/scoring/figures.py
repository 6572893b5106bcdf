"""The figures of a scorecard row, from the exact contact force at every step, and what is asked of them.

Force is the exact contact force along the tool axis (tool frame, pressing positive), never a sensor's
reading. Each definition is stated once, in ``DEFINITIONS``; a figure that is not defined for a run is None.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

import numpy as np

from polish_sim.analysis.claim import Claim, figure_of
from polish_sim.analysis.metrics import (
    CONTACT_N,
    STEADY_AFTER_S,
    first_contact,
    moving_average,
    settling_time,
    time_step,
)
from polish_sim.arrays import Array, rms
from polish_sim.log import RETRACT_PHASE, Trace
from polish_sim.row_file import Row
from polish_sim.scoring.battery import APPROACH_20, Case, Draw, latency_settings, spring_settings

#: A moving mean over this keeps how the force follows the part and takes oscillation away [s]
SLOW_S = 0.25
#: Amplitude a stable loop may swing with, as a share of the wanted force [-]
LARGEST_OSCILLATION = 0.1
LEAST_ALLOWED_N = 2.0  #: The amplitude allowed at small forces [N]
LARGEST_GROWTH = 2.0  #: Of the amplitude from the third to the last quarter of the window [-]
QUIET_N = 0.5  #: Growth below this amplitude is noise [N]

DEFINITIONS: Mapping[str, str] = {
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
        "peak_force_n": force[since].max(),
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
    """Figures of the error in the window, undefined without one."""
    error = error if len(error) else np.array([math.nan])
    size = np.abs(error)
    return {
        "rms_error_n": rms(error),
        "p95_error_n": np.percentile(size, 95),
        "max_error_n": size.max(),
        "mean_error_n": error.mean(),
        "std_n": error.std(),
    }


def _amplitude(fast: Array) -> float:
    return math.sqrt(2.0 * float(np.mean(fast**2)))


# What is asked of them.


SPRINGS = (0.2, 0.5, 1.0, 2.0, 5.0)  #: Real springs by what the controller takes them for [-]
LATENCIES_MS = (2, 4, 8, 12, 20)  #: Total latencies [ms]


REACH_CASES = (
    Case("reach-step", "20 N on a flat plate, approach 20 mm/s, held 4 s", "force", (APPROACH_20,)),
    Case(
        "reach-freeform-10",
        "the main job as it is: freeform, 8 mm step-over, whole path at 10 mm/s",
        "surface",
    ),
    Case("reach-freeform-30", "the main job at 30 mm/s, whole path", "surface", ("process.feed_m_s=0.03",)),
    *(
        Case(
            f"reach-springs-{springs:g}x-{latency}ms",
            f"20 N on a plate, springs {springs:g} x, {latency} ms in all, approach 20 mm/s",
            "force",
            (*spring_settings(springs), *latency_settings(latency), APPROACH_20),
        )
        for springs in SPRINGS
        for latency in LATENCIES_MS
    ),
    Case(
        "reach-random",
        "freeform, 16 mm step-over, whole path at 20 to 60 mm/s, landing at 5 to 20 mm/s, the part up to 3 "
        "mm and 2 deg off and bent by up to 0.5 mm",
        "surface",
        ("plan.stepover_m=0.016", "safety.offset_limit_m=0.01"),
        (
            Draw("process.feed_m_s", 0.02, 0.06),
            Draw("process.approach_speed_m_s", 0.005, 0.02),
            Draw("part.displacement_m", 0.0, 0.003),
            Draw("part.rotation_rad", 0.0, math.radians(2.0)),
            Draw("part.form_error_m", 0.0, 0.0005),
        ),
        repeats=10,
    ),
)
"""One case, or a grid of them, for each row asked."""


class Asked(NamedTuple):
    """What is asked of a figure at the worst seed of some cases."""

    claim: Claim
    cases: str  #: Shell pattern of their names

    def applies(self, case: str) -> bool:
        """Whether it is asked in a case."""
        return fnmatchcase(case, self.cases)


STABLE = Claim("stable", "stable", "", low=1.0, high=1.0, more_is_better=True)
_STEP = (
    Claim("settling_1n_s", "force step 20 N at 20 mm/s: settling to ±1 N", "s", "0.5 s to ±3 N", high=0.25),
    Claim("overshoot_n", "force step 20 N at 20 mm/s: overshoot", "N", high=1.0),
    Claim("std_n", "steady: standard deviation", "N", "±3 N", high=0.3),
    Claim("max_error_n", "steady: max error", "N", "±3 N", high=1.0),
    Claim("peak_force_n", "approach 20 mm/s: peak force", "N", high=30.0),
)
_SLOW = (
    Claim("max_error_n", "freeform 10 mm/s: max error", "N", "±4 N", high=1.5),
    Claim("rms_error_n", "freeform 10 mm/s: RMS", "N", "±1.5 N", high=0.4),
    Claim("peaks_error_n", "freeform 10 mm/s: at the peaks", "N", high=1.5),
)
_FAST = (Claim("max_error_n", "freeform 30 mm/s: max error", "N", high=3.0),)
_RANDOM = (Claim("contact_lost_s", "200 random freeform runs: contact lost", "s", high=0.0),)
_OF_GRID = (STABLE, Claim("settling_1n_s", "settling to ±1 N", "s", high=0.6))


def _asked(claims: Iterable[Claim], cases: str, under: str = "") -> tuple[Asked, ...]:
    """What is asked in some cases; ``under``: what stands before the labels."""
    return tuple(Asked(claim._replace(label=under + claim.label), cases) for claim in claims)


REACH = (
    *_asked(_STEP, "reach-step"),
    *_asked(_SLOW, "reach-freeform-10"),
    *_asked(_FAST, "reach-freeform-30"),
    *_asked(_OF_GRID, "reach-springs-*", "springs x 0.2-5, latency 2-20 ms: "),
    *_asked(_RANDOM, "reach-random"),
)
"""The rows asked; payload and faults have commands of their own, see docs/score.md."""
BATTERY_ASKED = (
    *_asked(_STEP, "approach-20"),
    *_asked(_SLOW, "freeform-10"),
    *_asked(_FAST, "freeform-30"),
    *_asked(_OF_GRID, "stiffness-*", "stiffness: "),
    *_asked(_OF_GRID, "latency-*", "latency: "),
)
"""The same asked of the cases of the battery."""


class JudgedFigure(NamedTuple):
    """A figure that was asked, measured."""

    claim: Claim
    runs: int
    mean: float | None
    worst: float | None  #: Of ``stable`` the share of runs that are
    worst_case: str | None  #: Case and seed of the least good run
    met: bool


def judge(asked: Sequence[Asked], rows: Sequence[Row]) -> list[JudgedFigure]:
    """Compare rows of one controller with what is asked of them; what no row speaks of is left out."""
    verdicts = []
    for one in asked:
        claim, fitting = one.claim, [row for row in rows if one.applies(row["case"])]
        if fitting:
            mean, worst = spread([row[claim.figure] for row in fitting])
            worst = mean if claim.figure == "stable" else worst
            least_good = max(fitting, key=lambda row: claim.badness(figure_of(row, claim.figure)))
            where = f"{least_good['case']}, seed {least_good['seed']}"
            met = claim.met_by(math.nan if worst is None else worst)
            verdicts.append(JudgedFigure(claim, len(fitting), mean, worst, where, met))
    return verdicts
