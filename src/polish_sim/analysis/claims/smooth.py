"""What is asked of the rules of smoothing, side by side (layer 8c)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from polish_sim.analysis.claims.claim import PATH_DONE, Claim

SMOOTH: Final[Mapping[str, tuple[Claim, ...]]] = {
    "smooth": (
        Claim(
            "certified_reduction_largest",
            "certified: error less at a jerk peak, largest",
            "%",
            100.0,
            "14.57",
            low=0.1457,
            more_is_better=True,
        ),
        Claim("certified_reduction_median", "  median of the peaks", "%", 100.0, more_is_better=True),
        Claim("certified_rise_largest", "  largest rise at one", "%", 100.0),
        Claim(
            "certified_reduction_largest_at_equal_time",
            "  largest, equal cycle times",
            "%",
            100.0,
            more_is_better=True,
        ),
        Claim(
            "certified_reduction_median_at_equal_time",
            "  median, equal cycle times",
            "%",
            100.0,
            more_is_better=True,
        ),
        Claim("joint_jerk_reduction_largest", "joint-jerk: largest", "%", 100.0, "14.57", more_is_better=True),
        Claim("joint_jerk_reduction_median", "  median of the peaks", "%", 100.0, more_is_better=True),
        Claim("certified_joint_jerk_ratio_max", "certified: joint jerk / limit", "", 1.0, high=1.0 + 1e-9),
        Claim("joint_jerk_joint_jerk_ratio_max", "joint-jerk: joint jerk / limit", "", 1.0, "< 1"),
        Claim("joint_acceleration_joint_jerk_ratio_max", "joint-acceleration: joint jerk / limit", "", 1.0, "> 1"),
        Claim("certified_cycle_time_s", "certified: cycle time", "s", 1.0),
        Claim("joint_jerk_cycle_time_s", "joint-jerk: cycle time", "s", 1.0, "13.215"),
        Claim("joint_acceleration_cycle_time_s", "joint-acceleration: cycle time", "s", 1.0, "13.169"),
        PATH_DONE,
    ),
}
