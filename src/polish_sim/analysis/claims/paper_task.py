"""When a run is the paper's own trial, so that the paper's figures may stand beside it (layer 8c)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Final

from polish_sim.analysis.claims.claim import Claim
from polish_sim.analysis.claims.registry import CLAIMS, claims_of
from polish_sim.config import Scenario

NO_FIGURE: Final = "-"

PAPER_TASKS: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "arc": {"process.feed_m_s": 0.01},
        "force": {"part.file": "plate", "process.contact_force_n": 20.0},
        "surface": {
            "part.file": "freeform",
            "plan.file": "",
            "process.contact_force_n": 20.0,
            "process.feed_m_s": 0.01,
        },
        "smooth": {"plan.file": "", "smoothing.limits_file": ""},
    }
)
"""What of a scenario makes it the trial the papers report, by experiment; others have no such key."""


def is_paper_task(scenario: Scenario) -> bool:
    """Whether part, path, force and feed of a run are those of the paper's trial."""
    task = PAPER_TASKS.get(scenario.experiment, {})
    return all(attrgetter(name)(scenario) == value for name, value in task.items())


def claims_shown(scenarios: Sequence[Scenario]) -> tuple[Claim, ...]:
    """The figures to show of runs of one experiment: what is asked of any of them.

    The paper's figures are left out unless every run is the paper's trial.
    """
    claims = {claim.figure: claim for scenario in scenarios for claim in CLAIMS[claims_of(scenario)]}.values()
    if all(map(is_paper_task, scenarios)):
        return tuple(claims)
    return without_paper(claims)


def without_paper(claims: Iterable[Claim]) -> tuple[Claim, ...]:
    """The same claims without the paper's figures."""
    return tuple(claim._replace(paper=NO_FIGURE) for claim in claims)
