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
}


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


def ablation_table(score: Score) -> Table:
    """For each law: how much each figure grows without it, over the cases on average and in the case it grows most.

    Args:
        score: A score whose first controller is the whole one and the others lack a law each.

    Returns:
        Headings and rows; a positive change is what the law is worth.
    """
    summaries = summarize(score.cases, score.entries, score.rows)
    whole = {s.case.name: s for s in summaries if s.entry == score.entries[0]}
    headings = ["law left out"]
    headings += [f"{label}: mean change / most, where" for label in _FIGURES.values()] + ["unstable runs"]
    rows = []
    for entry in score.entries[1:]:
        own = [s for s in summaries if s.entry == entry and s.case.name in whole]
        cells = [_changes([(whole[s.case.name], s) for s in own], figure) for figure in _FIGURES]
        more = sum(len(s.rows) - s.stable for s in own) - sum(
            len(whole[s.case.name].rows) - whole[s.case.name].stable for s in own
        )
        rows.append([entry.label.removeprefix("without "), *cells, f"{more:+d}"])
    return headings, rows


def _changes(pairs: list[tuple[Summary, Summary]], figure: str) -> str:
    changes = {}
    for with_it, without in pairs:
        before, after = with_it.figures[figure].mean, without.figures[figure].mean
        if before is not None and after is not None:
            changes[with_it.case.name] = after - before
    if not changes:
        return "-"
    most = max(changes, key=lambda name: abs(changes[name]))
    mean = sum(changes.values()) / len(changes)
    return f"{_signed(mean)} / {_signed(changes[most])} {most}"


def _signed(value: float) -> str:
    return ("+" if value >= 0.0 else "") + number(value)


def _laws(entry: Entry) -> list[str]:
    if entry.name != COMPOSED:
        raise InputError(f"--ablate leaves out laws of '{COMPOSED}'; '{entry.label}' is not composed of any.")
    config: Any = override(default_scenario("force"), list(entry.settings)).controller
    laws = [law for law in re.split(r"[\s,]+", str(config.adaptive.laws)) if law]
    if not laws:
        raise InputError(f"{KEY} is empty: there is no law to leave out.")
    return laws
