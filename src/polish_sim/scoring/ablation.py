"""What each law of a composed controller is worth: the battery with one of them left out at a time (layer 10)."""

from __future__ import annotations

import re
from typing import Any, Final

from polish_sim.errors import InputError
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.scoring.case import Entry
from polish_sim.scoring.score import Score
from polish_sim.scoring.summary import Summary, summarize
from polish_sim.scoring.text import Table, number

COMPOSED: Final = "hybrid-adaptive"
"""The controller whose laws can be left out."""
KEY: Final = "controller.adaptive.laws"

_FIGURES: Final = {
    "settling_1n_s": "settling [s]",
    "overshoot_n": "overshoot [N]",
    "rms_error_n": "RMS [N]",
    "max_error_n": "max [N]",
    "slowed": "slowed [-]",
}
_WITHOUT: Final = "without "
_NOTHING: Final = 5e-4  # a smaller change is none


def ablations(entry: Entry) -> list[Entry]:
    """The controller without one of its laws, once for each.

    Raises:
        InputError: If the controller has no laws that could be left out.
    """
    laws = _laws(entry)
    return [
        Entry(
            f"without {law}",
            entry.name,
            (*entry.settings, f"{KEY}={' '.join(other for other in laws if other != law)}"),
        )
        for law in laws
    ]


def ablation_table(score: Score, places: bool = True) -> Table:
    """For each law: how much each figure grows without it, over the cases on average and in the case it grows most.

    Args:
        score: A score whose first controller is the whole one and the others lack a law each.
        places: Whether the case of the largest change is named.

    Returns:
        Headings and rows; a positive change is what the law is worth.
    """
    whole = {s.case.name: s for s in _of(score, score.entries[0])}
    headings = ["law left out", *(f"{label}: mean, most" if places else label for label in _FIGURES.values())]
    rows = []
    for entry in score.entries[1:]:
        pairs = [(whole[s.case.name], s) for s in _of(score, entry) if s.case.name in whole]
        cells = [_told(_changes(pairs, figure), places) for figure in _FIGURES]
        more = sum(with_it.stable - without.stable for with_it, without in pairs)
        rows.append([entry.label.removeprefix(_WITHOUT), *cells, f"{more:+d}"])
    return [*headings, "unstable runs"], rows


def ablation_ratios(score: Score) -> dict[str, dict[str, dict[str, float]]]:
    """Each figure without a law by what it is with it, by law, figure and case; where both are known and not zero."""
    whole = {s.case.name: s for s in _of(score, score.entries[0])}
    ratios: dict[str, dict[str, dict[str, float]]] = {}
    for entry in score.entries[1:]:
        law = ratios.setdefault(entry.label.removeprefix(_WITHOUT), {figure: {} for figure in _FIGURES})
        for summary in _of(score, entry):
            for figure in _FIGURES:
                before = whole[summary.case.name].figures[figure].mean if summary.case.name in whole else None
                after = summary.figures[figure].mean
                if before and after:
                    law[figure][summary.case.name] = after / before
    return ratios


def _of(score: Score, entry: Entry) -> list[Summary]:
    return [s for s in summarize(score.cases, score.entries, score.rows) if s.entry == entry]


def _changes(pairs: list[tuple[Summary, Summary]], figure: str) -> dict[str, float]:
    changes = {}
    for with_it, without in pairs:
        before, after = with_it.figures[figure].mean, without.figures[figure].mean
        if before is not None and after is not None:
            changes[with_it.case.name] = after - before
    return changes


def _told(changes: dict[str, float], places: bool) -> str:
    if not changes:
        return "-"
    most = max(changes, key=lambda name: abs(changes[name]))
    mean = sum(changes.values()) / len(changes)
    return f"{_signed(mean)}, {_signed(changes[most])}" + (f" in {most}" if places else "")


def _signed(value: float) -> str:
    return ("+" if value >= 0.0 else "") + number(value if abs(value) >= _NOTHING else 0.0)


def _laws(entry: Entry) -> list[str]:
    if entry.name != COMPOSED:
        raise InputError(f"--ablate leaves out laws of '{COMPOSED}'; '{entry.label}' is not composed of any.")
    config: Any = override(default_scenario("force"), list(entry.settings)).controller
    laws = [law for law in re.split(r"[\s,]+", str(config.adaptive.laws)) if law]
    if not laws:
        raise InputError(f"{KEY} is empty: there is no law to leave out.")
    return laws
