"""What the papers report and what we ask of a run: the figures shown at the end, a file per kind of run (layer 8c)."""

from polish_sim.analysis.claims.claim import Claim, bound_text, value_text
from polish_sim.analysis.claims.paper_task import claims_shown, is_paper_task, without_paper
from polish_sim.analysis.claims.registry import CLAIMS, claims_of, shortfalls

__all__ = [
    "CLAIMS",
    "Claim",
    "bound_text",
    "claims_of",
    "claims_shown",
    "is_paper_task",
    "shortfalls",
    "value_text",
    "without_paper",
]
