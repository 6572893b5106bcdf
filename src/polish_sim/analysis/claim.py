"""One figure of a run, how it is shown, and what is asked of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from polish_sim.errors import InputError, number_text
from polish_sim.page import SCALES, Table
from polish_sim.row_file import Metrics


class Claim(NamedTuple):
    """One figure of an experiment, how it is shown, what the paper says, and the range asked of it."""

    figure: str  #: Its name in metrics.json
    label: str
    unit: str  #: Unit in which it is shown
    paper: str = "-"
    low: float = -math.inf  #: Least value that passes [SI]
    high: float = math.inf  #: Largest value that passes [SI]
    more_is_better: bool = False
    is_mean: bool = False  #: Neither more nor less is better: no value is the worst

    @property
    def scale(self) -> float:
        """Shown value / SI value."""
        return SCALES.get(self.unit, 1.0)

    @property
    def bounded(self) -> bool:
        """Whether anything is asked of the figure."""
        return math.isfinite(self.low) or math.isfinite(self.high)

    def met_by(self, value: float) -> bool:
        """Whether a value [SI] passes; an undefined one (NaN) never does where a range is asked."""
        return not self.bounded or self.low <= value <= self.high

    def badness(self, value: float) -> float:
        """The larger, the less good a value; an undefined one is less good than any."""
        return math.inf if math.isnan(value) else -value if self.more_is_better else value

    def worst_of(self, values: Sequence[float]) -> float:
        """The least good value; NaN without values, or where one is undefined."""
        return math.nan if self.is_mean else max(values, key=self.badness, default=math.nan)


HOLD_BAND_N, FOLLOW_BAND_N = 3.0, 4.0  #: About the set force, on one point and along a path (paper 1)
PATH_DONE = Claim("path_done", "path done", "%", "100", low=1.0, more_is_better=True)


def figure_of(figures: Metrics, name: str) -> float:
    """A figure of a run [SI]; NaN where it has none, or it is undefined.

    Raises:
        InputError: It is no number, as in a file that was edited.
    """
    value: float | None = figures.get(name)
    if value is None:
        return math.nan
    if not hasattr(value, "__float__"):
        raise InputError(
            f"'{name}' in a run's metrics.json is not a number: {value!r:.60}. Delete the entry to see the "
            "run without it."
        )
    return value


def bound_text(claim: Claim) -> str:
    """The range asked of a figure, as it is shown, e.g. ``<= 0.1``."""
    if math.isfinite(claim.low) and math.isfinite(claim.high):
        return f"{number_text(claim.low * claim.scale)} to {number_text(claim.high * claim.scale)}"
    if math.isfinite(claim.low):
        return f">= {number_text(claim.low * claim.scale)}"
    return f"<= {number_text(claim.high * claim.scale)}" if claim.bounded else "-"


def value_text(claim: Claim, value: float) -> str:
    """A figure in its shown unit with three or four significant digits; an undefined one is a dash."""
    return "-" if math.isnan(value) else number_text(float(value * claim.scale), 4)


def figure_table(
    claims: Iterable[Claim],
    columns: Mapping[str, Metrics],
    settings: Sequence[Sequence[str]] = (),
    met: bool = True,
    conditions: Sequence[str] = (),
) -> Table:
    """Figures by heading beside the paper's and what is asked of them, and whether the last column meets it.

    Args:
        claims: The figures.
        columns: Their values by heading.
        settings: Rows above them: label, unit, a value for each column.
        met: Whether there is such a verdict.
        conditions: Other conditions than those the figures are asked for; there is no verdict then.
    """
    runs = list(columns.values())
    met = met and not conditions
    rows = [[*row, *[""] * (2 + met)] for row in settings]
    for claim in claims:
        values = [figure_of(metrics, claim.figure) for metrics in runs]
        asked = bound_text(claim) if claim.bounded else "not asked"
        verdict = ("yes" if claim.met_by(values[-1]) else "NO") if claim.bounded else ""
        shown = [value_text(claim, value) for value in values]
        rows.append([claim.label, claim.unit, *shown, claim.paper, asked, *[verdict][:met]])
    caption = f"'met' is left out: figures are asked for other conditions, here {', '.join(conditions)}."
    headings = ["figure", "unit", *columns, "paper", "asked", *["met"][:met]]
    return Table("Figures", headings, rows, caption=caption if conditions else "")


def shortfalls(claims: Iterable[Claim], figures: Metrics) -> list[Claim]:
    """The claims that figures do not meet."""
    return [claim for claim in claims if not claim.met_by(figure_of(figures, claim.figure))]
