"""What is asked of hand guiding (layer 8c)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from polish_sim.analysis.claims.claim import DEGREES, PATH_DONE, Claim

_LET_GO: Final = (
    Claim("drift_rad", "hands off, drift", "deg", DEGREES, "-", high=0.01 / DEGREES),
    Claim("lent_energy_j", "energy lent, most", "J", 1.0),
)

TEACH: Final[Mapping[str, tuple[Claim, ...]]] = {
    "teach": (
        Claim("none_peak_n", "hand force, nothing compensated, peak", "N", 1.0, "> 100"),
        Claim("classical_peak_n", "  gravity and friction (classical)", "N", 1.0, "< 30"),
        Claim("fast_peak_ratio_x", "fast move along x, inertia / classical, peak", "", 1.0, "0.714", high=0.45),
        Claim("fast_rms_ratio_x", "  rms", "", 1.0, "-", high=0.30),
        Claim("fast_peak_ratio_y", "along y, peak", "", 1.0, "0.714", high=0.45),
        Claim("fast_rms_ratio_y", "  rms", "", 1.0, "-", high=0.30),
        Claim("assist_fast_peak_ratio_x", "with start-up assist: along x, peak", "", 1.0),
        Claim("assist_fast_rms_ratio_x", "  rms", "", 1.0),
        Claim("assist_fast_peak_ratio_y", "  along y, peak", "", 1.0),
        Claim("assist_fast_rms_ratio_y", "  rms", "", 1.0),
        Claim("slow_peak_n", "  slow moves, peak", "N", 1.0, "-", high=10.0),
        *_LET_GO,
        PATH_DONE,
    ),
    "teach-some": (
        Claim("hand_force_peak_n", "hand force, last mode, peak", "N", 1.0),
        Claim("hand_force_rms_n", "  rms", "N", 1.0),
        *_LET_GO,
        PATH_DONE,
    ),
    "teach-one": (
        Claim("hand_force_peak_n", "hand force, peak", "N", 1.0),
        Claim("hand_force_rms_n", "  rms", "N", 1.0),
        *_LET_GO,
        PATH_DONE,
    ),
    # An arm that does not carry itself is not let go.
    "teach-none": (
        Claim("hand_force_peak_n", "hand force, peak", "N", 1.0),
        Claim("hand_force_rms_n", "  rms", "N", 1.0),
        PATH_DONE,
    ),
    "teach-path": (
        Claim("taught_deviation_max_m", "taught path off what was meant, max", "mm", 1e3),
        Claim("taught_deviation_rms_m", "  rms", "mm", 1e3),
        Claim("recorded_deviation_max_m", "recording off it, max", "mm", 1e3),
        Claim("recorded_deviation_rms_m", "  rms", "mm", 1e3),
        Claim("taught_missed_max_m", "what was meant off the taught path, max", "mm", 1e3),
        Claim("taught_axis_error_max_rad", "tool axis, max", "deg", DEGREES),
        Claim("points_recorded", "points recorded", "", 1.0),
        Claim("points_taught", "points taught", "", 1.0),
        Claim("hand_force_peak_n", "hand force, peak", "N", 1.0),
        Claim("hand_force_rms_n", "  rms", "N", 1.0),
        PATH_DONE,
    ),
}
