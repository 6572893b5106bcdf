"""What is asked of each experiment, by its name: shown at the end of a run and checked by --check (layer 8c)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

from polish_sim.analysis.claims.calibrate import CALIBRATE
from polish_sim.analysis.claims.claim import Claim
from polish_sim.analysis.claims.dual import DUAL
from polish_sim.analysis.claims.identify import IDENTIFY
from polish_sim.analysis.claims.one_robot import ONE_ROBOT
from polish_sim.analysis.claims.smooth import SMOOTH
from polish_sim.analysis.claims.teach import TEACH
from polish_sim.config import Scenario

CLAIMS: Final[Mapping[str, tuple[Claim, ...]]] = MappingProxyType(
    {**ONE_ROBOT, **DUAL, **SMOOTH, **TEACH, **CALIBRATE, **IDENTIFY}
)


def claims_of(scenario: Scenario) -> str:
    """The name in ``CLAIMS`` of what is asked of a run: some moves are no trial, above a part is no force."""
    guide = scenario.guide
    if scenario.experiment == "teach" and scenario.drag.follow:
        return "teach-path"
    if scenario.experiment == "teach" and (guide.mode or guide.direction or guide.duration_s):
        if not guide.mode:
            return "teach-some"
        return "teach-none" if guide.mode == "none" else "teach-one"
    if scenario.experiment == "dual" and scenario.dual.standoff_m > 0.0:
        return "dual-free"
    return scenario.experiment


def shortfalls(experiment: str, metrics: Mapping[str, Any]) -> list[Claim]:
    """The claims of an experiment that its figures do not meet."""
    return [claim for claim in CLAIMS[experiment] if not claim.met_by(metrics.get(claim.figure))]
