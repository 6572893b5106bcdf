"""How a run ended: its figures beside the paper's, and the exit code of the contract."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from polish_sim.analysis.claim import Claim, bound_text, shortfalls, value_text
from polish_sim.cli import console
from polish_sim.cli.boundary import DONE, INTERRUPTED, SHORT, STOPPED


@dataclass(frozen=True)
class Outcome:
    """One run, or several seeds of one: the figures that count."""

    claims: Sequence[Claim]
    """The figures to show and what is asked of them."""
    title: str
    columns: Mapping[str, Mapping[str, Any]]
    """Columns of figures to show by heading; the last one is the one that is checked."""
    stops: tuple[str, ...] = ()
    """Protective stops, each with its reason."""
    interrupted: bool = False
    undrawn: str = ""
    """What draws the pictures that are missing because it was broken off after all was measured."""
    notes: tuple[str, ...] = ()
    """What else there is to say."""

    def show(self) -> None:
        """Print why the run ended early, if it did, and the table of figures."""
        if self.interrupted:
            console.note("interrupted: what was recorded up to now is kept.")
        if self.undrawn:
            console.note(
                "interrupted while drawing: the simulation, its log and figures are whole and kept, but pictures are "
                f"missing. {self.undrawn}"
            )
        for reason in self.stops:
            end = "" if reason.endswith("?") else "."
            console.note(f"error: protective stop: {reason}{end} The log is kept, stop included.")
        for text in self.notes:
            console.note(text)
        show_figures(self.claims, self.title, self.columns, self._checked)

    def exit_code(self, check: bool) -> int:
        """The code to end with; falling short counts only when it was asked to ``check``."""
        if self.interrupted or self.undrawn:
            return INTERRUPTED
        if self.stops:
            return STOPPED
        return SHORT if check and shortfalls(self.claims, self._checked) else DONE

    @property
    def _checked(self) -> Mapping[str, Any]:
        return list(self.columns.values())[-1]


def show_figures(
    claims: Sequence[Claim],
    title: str,
    columns: Mapping[str, Mapping[str, Any]],
    checked: Mapping[str, Any] | None = None,
    settings: Sequence[Sequence[str]] = (),
) -> None:
    """Print figures beside the paper's and what is asked of them.

    Args:
        claims: The figures to show.
        title: Of the table.
        columns: Figures by heading.
        checked: Whose verdict stands at the end.
        settings: Rows above the figures: label, unit, a value for each column.
    """
    headings = ["figure", "unit", *columns, "paper", "asked"] + (["met"] if checked is not None else [])
    above = [[*row, *[""] * (len(headings) - len(row))] for row in settings]
    rows = [_row(claim, list(columns.values()), checked) for claim in claims]
    console.table(title, headings, above + rows)


def _row(claim: Claim, columns: Sequence[Mapping[str, Any]], checked: Mapping[str, Any] | None) -> list[str]:
    values = [value_text(claim, metrics.get(claim.figure)) for metrics in columns]
    row = [claim.label, claim.unit, *values, claim.paper, bound_text(claim)]
    if checked is None:
        return row
    verdict = "yes" if claim.met_by(checked.get(claim.figure)) else "NO"
    return [*row, verdict if claim.bounded else ""]
