"""What is asked of two robots, and of the tool on the part one of them holds (layer 8c)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from polish_sim.analysis.claims.claim import PATH_DONE, Claim

TOOL_ON_PART: Final = (
    Claim("relative_error_rms_m", "tool on the part, error rms", "mm", 1e3, high=6e-5),
    Claim("relative_error_p95_m", "  95% below", "mm", 1e3, high=1e-4),
)
_PAIR: Final = (
    Claim("tracking_error_worst_m", "tracking error, worst axis", "mm", 1e3, high=1e-4),
    *TOOL_ON_PART,
    Claim("chain_residual_m", "closed chain of the planned joints", "mm", 1e3, high=1e-9),
    Claim("master_way_m", "way of the part", "mm", 1e3),
    Claim("master_turn_rad", "turn of the part", "deg", math.degrees(1.0)),
)

DUAL: Final[Mapping[str, tuple[Claim, ...]]] = {
    "dual": (
        Claim("force_max_deviation_n", "force error, max", "N", 1.0, high=1.5),
        Claim("force_mean_n", "force, mean", "N", 1.0),
        Claim("force_rms_error_n", "force error, rms", "N", 1.0),
        Claim("force_within_1n", "force in ±1 N", "%", 100.0, more_is_better=True),
        Claim("contact_lost_s", "contact lost", "s", 1.0),
        *_PAIR,
        Claim("removal_cv", "removal, std / mean", "%", 100.0),
        PATH_DONE,
    ),
    "dual-free": (*_PAIR, PATH_DONE),
}
