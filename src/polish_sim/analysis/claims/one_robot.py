"""What is asked of the arc, the force step and the surface (layer 8c)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from polish_sim.analysis.claims.claim import PATH_DONE, Claim

ONE_ROBOT: Final[Mapping[str, tuple[Claim, ...]]] = {
    "arc": (
        Claim("tracking_error_max_m", "tracking error, max", "mm", 1e3, "< 0.3", high=1e-4),
        Claim("tracking_error_rms_m", "tracking error, rms", "mm", 1e3),
        Claim("speed_mean_m_s", "speed, mean", "mm/s", 1e3, "10"),
        Claim("speed_max_deviation_m_s", "speed deviation, max", "mm/s", 1e3, "held", high=1e-4),
        Claim("orientation_error_max_rad", "orientation error, max", "mrad", 1e3),
        PATH_DONE,
    ),
    "force": (
        Claim("settling_time_3n_s", "settling to ±3 N", "s", 1.0, "< 0.5", high=0.4),
        Claim("settling_time_1n_s", "settling to ±1 N", "s", 1.0),
        Claim("steady_within_3n", "in ±3 N after 0.5 s", "%", 100.0, "most", low=1.0, more_is_better=True),
        Claim("overshoot_n", "overshoot", "N", 1.0),
        Claim("rise_time_s", "rise 10-90%", "s", 1.0),
        Claim("steady_std_n", "steady force, std", "N", 1.0),
        PATH_DONE,
    ),
    "surface": (
        Claim("force_within_4n", "force in ±4 N", "%", 100.0, "100, six dips", low=0.995, more_is_better=True),
        Claim("force_within_1n", "force in ±1 N", "%", 100.0, more_is_better=True),
        Claim("force_mean_n", "force, mean", "N", 1.0, "20"),
        Claim("force_rms_error_n", "force error, rms", "N", 1.0),
        Claim("force_max_deviation_n", "force error, max", "N", 1.0, "4"),
        Claim("force_error_at_peaks_n", "largest error at a peak, mean of the peaks", "N", 1.0),
        Claim("force_error_median_n", "force error, median", "N", 1.0),
        Claim("curvature_peaks", "curvature peaks", "", 1.0, "6"),
        Claim("contact_lost_s", "contact lost", "s", 1.0, "0"),
        Claim("tracking_error_max_m", "tangential error, max", "mm", 1e3, "-", high=3e-4),
        Claim("speed_mean_m_s", "speed, mean", "mm/s", 1e3, "constant"),
        Claim("removal_cv", "removal, std / mean", "%", 100.0),
        Claim("under_polished_share", "removal below half its mean", "%", 100.0),
        Claim("over_polished_share", "removal above 1.5 x its mean", "%", 100.0),
        PATH_DONE,
    ),
}
