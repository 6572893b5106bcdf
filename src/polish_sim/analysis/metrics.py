"""The figures of a run, from its exact force and pose at every step.

What each figure means is stated once, here; a figure that is not defined for a run (no contact, an empty
phase) is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.analysis.claim import FOLLOW_BAND_N
from polish_sim.arrays import Array, Bools, Figures, Indices, norms, rms, running_sums
from polish_sim.log import RETRACT_PHASE, RemovalMap, Trace
from polish_sim.planning.toolpath import BEFORE, ToolPath, stretches

# Where the path's curvature changes strongly, and what the force does there (paper 1, fig. 15).

FLAT_1_M = 1.0 / 0.300  #: Below this normal curvature the path counts as gentle [1/m]
SHARP_1_M = 1.0 / 0.120  #: A peak of the normal curvature rises above this [1/m]
WINDOW_M = 0.015  #: Half-width of a peak's window along the path [m]: the curvature rises within 15 mm


class PeakErrors(NamedTuple):
    """Largest force error per window, averaged over the windows at the peaks and over those away from
    them."""

    passed: int  #: Peaks
    at_peaks_n: float
    between_peaks_n: float


def curvature_peaks(path: ToolPath) -> NDArray[np.intp]:
    """Ascending indices of the path's points where its normal curvature rises from gentle to sharp.

    A bend is a stretch of process points whose curvature's magnitude stays at ``FLAT_1_M`` or above; its
    largest value is a peak if it exceeds ``SHARP_1_M``. Ripples on a bend are one peak, and humps and hollows
    count alike. A path that is never flat, as on a small sphere, has none.
    """
    process = np.flatnonzero(path.process)
    magnitude = np.abs(path.curvature[process])
    bent = magnitude >= FLAT_1_M
    tops = [first + np.argmax(magnitude[first : last + 1]) for first, last in stretches(bent)]
    return process[[top for top in tops if magnitude[top] > SHARP_1_M and not bent.all()]]


def errors_at_peaks(path: ToolPath, path_s: Array, force_error: Array) -> PeakErrors:
    """Means of the force error [N] (n,) at places on a path [m] (n,), at its curvature peaks up to the last
    of them and in stretches of the same length elsewhere; NaN if none.

    The largest of many noisy samples is large anywhere, so the peaks are compared with the same statistic
    between them.
    """
    peaks_s = path.s[curvature_peaks(path)]
    peaks_s = peaks_s[peaks_s <= path_s.max(initial=-math.inf)]
    magnitude = np.abs(force_error)
    at_peaks = [_largest(path_s, magnitude, s - WINDOW_M, s + WINDOW_M) for s in peaks_s]
    edges = np.arange(path_s[0], path_s[-1] - 2 * WINDOW_M, 2 * WINDOW_M) if len(path_s) else np.empty(0)
    between = [
        _largest(path_s, magnitude, low, low + 2 * WINDOW_M)
        for low in edges
        if not np.any((peaks_s > low - WINDOW_M) & (peaks_s < low + 3 * WINDOW_M))
    ]
    return PeakErrors(len(peaks_s), _mean(at_peaks), _mean(between))


def _largest(path_s: Array, magnitude: Array, low: float, high: float) -> float:
    start, stop = np.searchsorted(path_s, [low, high])
    return magnitude[start:stop].max() if stop > start else math.nan


def _mean(values: list[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return float(np.mean(known)) if known else math.nan


# How a signal behaves in time: contact, settling, rise, averages; the arithmetic under the figures.


CONTACT_N = 0.5  #: The tool is in contact when the exact normal force is above this [N]


def first_contact(force: Array) -> int | None:
    """Index of the first sample in contact; None without contact; ``force`` [N], shape (n,)."""
    touching = force > CONTACT_N
    return int(touching.argmax()) if touching.any() else None


def settling_time(time: Array, error: Array, band: float) -> float:
    """Time from the first sample, e.g. first contact, to the moment after which an error stays inside ± a
    band.

    0 if it never leaves the band, NaN if it is outside at the last sample, or without samples.
    """
    outside = np.flatnonzero(~(np.abs(error) <= band))
    if len(time) == 0 or (len(outside) and outside[-1] == len(time) - 1):
        return math.nan
    return time[outside[-1] + 1] - time[0] if len(outside) else 0.0


def rise_time(time: Array, value: Array, target: float) -> float:
    """Time between first reaching 10% and first reaching 90% of a target [s]; NaN when 90% is never
    reached."""
    reached = value >= 0.9 * target
    if not reached.any():
        return math.nan
    return time[reached.argmax()] - time[np.argmax(value >= 0.1 * target)]


def moving_average(time: Array, value: Array, window: float) -> Array:
    """Mean over a sliding window [s], whole windows only: (n - k + 1,) for n evenly spaced samples, k to a
    window."""
    if len(time) < 2:
        return np.empty(0)
    samples = max(1, round(window / np.median(np.diff(time))))
    if samples > len(value):
        return np.empty(0)
    sums = running_sums(value)
    return (sums[samples:] - sums[:-samples]) / samples


RAMP_UP_S = 1.0
STEADY_AFTER_S = 0.5  #: The steady window of a hold begins this long after first contact [s]
SPEED_WINDOW_S = 0.05
BRAKING = 0.99  #: Share of the feed below which the target brakes at the end [-]


WITHIN_BAND = 0.995  #: Share of the process in which the force is to be within its band
MOST_FORCE = 1.25  #: Of the set force: more is a blow
UNSURE_M = 3e-4  #: Form error that real parts are drawn with: what a proof allows for [m]
LEFT_OUT = 0.01  #: Share of the region that may be left out without a word


def force_shares(force: Array, wanted: Array, most: float, held: Bools) -> tuple[Array, Array]:
    """How much of what a run of ``surface`` may be off its force is used at each step, twice (n,): 1 is bad.

    First of what no step may be: a blow, ``MOST_FORCE`` times the ``most`` that is set [N], and where the
    force is ``held``, contact lost. Then, where it is held, of the band about the force ``wanted``, which few
    steps may leave.
    """
    error = force - wanted
    lost = np.where(held, -error / (wanted - CONTACT_N), 0.0)
    band = np.where(held, np.abs(error) / FOLLOW_BAND_N, 0.0)
    return np.maximum(error / (MOST_FORCE * most - wanted), lost), band


def faults_of_force(figures: Mapping[str, Any], contact_force: float) -> list[str]:
    """What is bad about the force of a run, in sentences; ``contact_force`` is the largest one set [N]."""
    found = []
    lost = figures["contact_lost_s"]
    within = figures["force_within_4n"]
    if lost > 0.0:
        found.append(f"contact was lost for {lost:.3g} s")
    if within < WITHIN_BAND:
        found.append(
            f"the force was outside ±4 N for {100.0 * (1.0 - within):.3g}% of the process, by up to "
            f"{figures['force_max_deviation_n']:.1f} N"
        )
    if (unplaced := figures.get("removal_unplaced", 0.0)) > LEFT_OUT:
        found.append(f"the removal map lacks {100.0 * unplaced:.3g}% of the force: it is not of this run")
    if figures["peak_force_n"] > MOST_FORCE * contact_force:
        found.append(
            f"the force reached {figures['peak_force_n']:.1f} N where {contact_force:.3g} N were set"
        )
    return found


def faults_of_plan(figures: Mapping[str, Any]) -> list[str]:
    """What is bad about a plan or what a run made of it, in sentences: its fit, and what is left out."""
    unsure, left_out = figures.get("fit_unsure_m", 0.0), _much_left_out(figures)
    if unsure <= UNSURE_M:
        return left_out
    return [
        *left_out,
        f"the fit is unsure by {1e3 * unsure:.2g} mm between vertices of the mesh: mesh the part finer, or "
        "set --feature-angle to less than its edges bend",
    ]


def _much_left_out(figures: Mapping[str, Any]) -> list[str]:
    """What a plan or run leaves out of its region, in a sentence, if it is more than a hundredth of it."""
    region = figures.get("region_area_m2", 0.0)
    lost = {reason: area for reason, area in figures.get("left_out", {}).items() if reason != BEFORE}
    left = sum(lost.values())
    if left <= LEFT_OUT * region:
        return []
    why = "; ".join(f"{1e4 * area:.3g} cm^2 {reason}" for reason, area in lost.items())
    return [f"{1e4 * left:.3g} of the region's {1e4 * region:.3g} cm^2 are left out ({why})"]


def map_notes(figures: Mapping[str, Any], _: object) -> list[str]:
    """What a run's figures of removal do not say, if that is more than a hundredth of the region."""
    before = figures.get("left_out", {}).get(BEFORE, 0.0)
    if before <= LEFT_OUT * figures.get("region_area_m2", 0.0):
        return []
    return ["figures of removal are of this run alone: what was polished before it (--from) is not in them"]


class Circle(NamedTuple):
    """A circle in the base frame."""

    center: tuple[float, float, float]  #: [m]
    normal: tuple[float, float, float]  #: Unit normal of its plane
    radius: float  #: [m]


PAPER_ARC = Circle((0.0, -0.52, 0.0), (math.sqrt(0.5), math.sqrt(0.5), 0.0), 0.1)
"""The circle of paper 1, section 3, its plane read as normal (1, 1, 0) through the centre."""


def measure_arc(trace: Trace) -> Figures:
    """Measure how the tool follows the paper's circle, from 1 s after the feed's start to where the target
    brakes.

    tracking_error_max_m and _rms_m: distance from the tool point to the circle (as a curve, whatever the
    time); speed_mean_m_s, vibration included; speed_max_deviation_m_s: largest difference of the 50 ms
    average of the speed from the commanded feed; orientation_error_max_rad.
    """
    part = steady_feed(trace.fed, trace.time_s, trace.path_s_m)
    time = trace.time_s[part]
    speed = trace.tcp_speed_m_s[part]
    distance = distance_to_arc(trace.tcp_position_m[part])
    # The median leaves ramps at the ends out.
    feed = _reduce(np.median, np.diff(trace.path_s_m[part]) / np.diff(time))
    deviation = moving_average(time, speed, SPEED_WINDOW_S) - feed
    return {
        "tracking_error_max_m": _reduce(np.max, distance),
        "tracking_error_rms_m": _reduce(rms, distance),
        "speed_mean_m_s": _reduce(np.mean, speed),
        "speed_max_deviation_m_s": _reduce(np.max, np.abs(deviation)),
        "orientation_error_max_rad": _reduce(np.max, trace.orientation_error_rad[part]),
    }


def measure_force(trace: Trace, contact_force: float) -> Figures:
    """Measure the step response of the contact force, from first contact (force above 0.5 N) to the retract.

    contact_time_s: moment of first contact; rise_time_s: from 10% to 90% of the set force;
    settling_time_3n_s,
    settling_time_1n_s: from first contact to the moment after which the force stays inside the band,
    undefined if the run ended within 0.5 s of contact; overshoot_n: largest excess over the set force, 0 if
    none; steady_*: from 0.5 s after contact on.
    """
    held = trace.phase < RETRACT_PHASE
    time = trace.time_s[held]
    force = trace.normal_force_n[held]
    contact = first_contact(force)
    start = len(time) if contact is None else contact
    time = time[start:]
    error = force[start:] - contact_force
    steady = error[time >= time[0] + STEADY_AFTER_S] if len(time) else error
    return {
        "contact_time_s": time[0] if len(time) else math.nan,
        "rise_time_s": rise_time(time, error + contact_force, contact_force),
        "settling_time_3n_s": settling_time(time, error, 3.0) if len(steady) else math.nan,
        "settling_time_1n_s": settling_time(time, error, 1.0) if len(steady) else math.nan,
        "overshoot_n": max(0.0, _reduce(np.max, error)) if len(error) else math.nan,
        "steady_max_deviation_n": _reduce(np.max, np.abs(steady)),
        "steady_std_n": _reduce(np.std, steady),
        "steady_within_3n": _share(steady, 3.0),
    }


def measure_surface(trace: Trace, plan: ToolPath, contact_force: float) -> Figures:
    """Measure force and path while the tool is fed along the part; ``contact_force`` where the path names
    none.

    Errors are against the force wanted at that place of the path. force_mean_n, force_rms_error_n,
    force_max_deviation_n; force_within_4n, force_within_1n: shares of the time; force_error_median_n,
    force_error_p95_n: of the error's magnitude; contact_lost_s: time below 0.5 N; tracking_error_max_m:
    across the tool axis; speed_mean_m_s, speed_std_m_s: of the tool point as it is, vibration included (one
    of 5 mm/s across a feed of 10 mm/s makes the mean 11); feed_time_s: duration of the feed; curvature_peaks:
    how many, see `curvature_peaks`; force_error_at_peaks_n: mean over the peaks of the largest error within
    15 mm of the peak; force_error_between_peaks_n: the same for equally long stretches away from them.
    """
    part = trace.fed
    time = trace.time_s[part]
    force = trace.normal_force_n[part]
    path_s = trace.path_s_m[part]
    error = force - plan.force_at(path_s, contact_force)
    off = np.abs(error)
    peaks = errors_at_peaks(plan, path_s, error)
    return {
        "force_mean_n": _reduce(np.mean, force),
        "force_rms_error_n": _reduce(rms, error),
        "force_max_deviation_n": _reduce(np.max, off),
        "force_within_4n": _share(error, FOLLOW_BAND_N),
        "force_within_1n": _share(error, 1.0),
        "force_error_median_n": _reduce(np.median, off),
        "force_error_p95_n": np.percentile(off, 95) if len(off) else math.nan,
        "contact_lost_s": np.sum(force <= CONTACT_N) * time_step(time),
        "tracking_error_max_m": _reduce(np.max, trace.tangential_error_m[part]),
        "speed_mean_m_s": _reduce(np.mean, trace.tcp_speed_m_s[part]),
        "speed_std_m_s": _reduce(np.std, trace.tcp_speed_m_s[part]),
        "feed_time_s": time[-1] - time[0] if len(time) else math.nan,
        "curvature_peaks": peaks.passed,
        "force_error_at_peaks_n": peaks.at_peaks_n,
        "force_error_between_peaks_n": peaks.between_peaks_n,
    }


def distance_to_arc(points: Array) -> Array:
    """Distance from points, base frame, to the circle of ``arc`` [m], (n, 3) -> (n,)."""
    offset = points - PAPER_ARC.center
    height = offset @ PAPER_ARC.normal
    in_plane = norms(offset - height[:, None] * PAPER_ARC.normal)
    return np.hypot(height, in_plane - PAPER_ARC.radius)


def steady_feed(fed: Bools, time: Array, path_s: Array) -> Bools:
    """Rows (n,) of the process after the ramp-up and before the target last falls below 99% of its feed.

    Where the host has missed cycles the target catches up in one step, which is no feed: two in a row are.
    """
    if not fed.any():
        return fed
    steady = fed & (time >= time[fed.argmax()] + RAMP_UP_S)
    rows = np.flatnonzero(steady)
    rates = np.diff(path_s[rows]) / np.diff(time[rows])
    fast: Bools = rates >= BRAKING * (np.median(rates) if len(rates) else 0.0)
    at_feed = np.flatnonzero(fast[1:] & fast[:-1])
    if len(at_feed):
        steady[rows[at_feed[-1] + 1] + 1 :] = False
    return steady


def time_step(time: Array) -> float:
    """Time between evenly spaced samples [s]; NaN if there are none."""
    return np.median(np.diff(time)) if len(time) > 1 else math.nan


def _reduce(function: Callable[[Array], np.floating | float], values: Array) -> float:
    return float(function(values)) if len(values) else math.nan


def _share(error: Array, band: float) -> float:
    return float(np.mean(np.abs(error) <= band)) if len(error) else math.nan


# Figures of a removal map.


UNDER, OVER = 0.5, 1.5  #: Under- and over-polished is what lost less (more) than this many times the mean
REMOVAL_SPREAD = (
    "removal_cv", "removal_cv_inside", "removal_p5", "removal_p95", "removal_max", "under_polished_share",
    "over_polished_share",
)  # fmt: skip


def measure_removal(removal: RemovalMap, pad_radius: float = 0.0) -> dict[str, float]:
    """Measure a map over the region's area.

    exposure_nm: pressure x sliding speed integrated over the region and time; exposure_mean_n_m: the same per
    area; removal_area_m2: of the map; removal_volume_m3, removal_mean_m, removal_max_m: undefined without a
    wear coefficient; removal_cv: standard deviation over mean; removal_cv_inside: the same a pad's radius [m]
    inside the border; removal_p5, removal_p95, removal_max: over the mean, by area; under_polished_share,
    over_polished_share, unpolished_share: of the area, with less than 0.5 means, with more than 1.5, with
    nothing at all; removal_elsewhere: exposure that went to surfaces beside the region, over the region's;
    removal_unplaced: share of the force for which the pad touched no node; pressure_field_ratio: force of the
    pressure field as it was computed over the exact one.
    """
    shares = removal.areas / removal.areas.sum()
    total = removal.areas @ removal.exposure
    depth = removal.preston_1_pa if removal.absolute else math.nan
    out = {
        "exposure_nm": total,
        "exposure_mean_n_m": removal.mean,
        "removal_volume_m3": depth * total,
        "removal_mean_m": depth * removal.mean,
        "removal_max_m": depth * removal.exposure.max(),
        "removal_area_m2": removal.areas.sum(),
        **dict.fromkeys(REMOVAL_SPREAD, math.nan),
        "unpolished_share": shares[removal.exposure <= 0.0].sum(),
        "removal_elsewhere": removal.elsewhere_nm / total if total > 0.0 else math.nan,
        "removal_unplaced": removal.unplaced_share,
        "pressure_field_ratio": removal.field_ratio,
    }
    return out | _spread_of(removal, shares, pad_radius) if total > 0.0 else out


def spreads(
    relative: Array, areas: Array, places: Array, border: Indices, inside: float
) -> tuple[float, float]:
    """Standard deviation over mean, of a whole region and of what lies ``inside`` its border by this much
    [m].

    ``relative`` and ``areas`` are those of vertices at ``places`` (v, 3) [m], ``border`` (b, 2) edges between
    them; nan where no two lie so far inside.
    """
    away, _ = cKDTree(places[border[:, 0]]).query(places)
    found = []
    for some in (areas, np.where(away >= inside, areas, 0.0)):
        mean = (some @ relative) / some.sum() if np.count_nonzero(some) > 1 else 0.0
        square = some / some.sum() @ (relative / mean - 1.0) ** 2 if mean > 0.0 else math.nan
        found.append(math.sqrt(square))
    return found[0], found[1]


def _spread_of(removal: RemovalMap, shares: Array, pad_radius: float) -> dict[str, float]:
    relative = removal.relative
    order = np.argsort(relative)
    below = np.cumsum(shares[order]) - 0.5 * shares[order]
    low, high = np.interp([0.05, 0.95], below, relative[order])
    deviations = spreads(relative, removal.areas, removal.vertices, removal.border, pad_radius)
    beyond = shares[relative < UNDER].sum(), shares[relative > OVER].sum()
    found = map(float, (*deviations, low, high, relative.max(), *beyond))
    return dict(zip(REMOVAL_SPREAD, found, strict=True))
