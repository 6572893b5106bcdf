"""Many rows in few numbers: per case and controller the mean and the worst over the seeds (layer 10)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from polish_sim.scoring.case import Case, Entry
from polish_sim.scoring.row import Row

SHOWN: Final[Mapping[str, str]] = {
    "settling_1n_s": "settling [s]",
    "overshoot_n": "overshoot [N]",
    "rms_error_n": "RMS [N]",
    "p95_error_n": "p95 [N]",
    "max_error_n": "max [N]",
    "peak_force_n": "peak force [N]",
    "contact_lost_s": "lost [s]",
    "slowed": "slowed [-]",
}
"""Figures of the tables and their headings."""


SHORT: Final = ("settling", "overshoot", "RMS", "p95", "max", "peak", "lost", "slowed")
"""The same for the screen, where N and s are said in the title."""


class Spread(NamedTuple):
    """One figure over the seeds; None where it is undefined for a seed (worst) or for all (mean)."""

    mean: float | None
    worst: float | None


@dataclass(frozen=True)
class Summary:
    """One case and one controller over all its seeds."""

    case: Case
    entry: Entry
    rows: tuple[Row, ...]
    figures: Mapping[str, Spread]

    @property
    def stable(self) -> int:
        """Number of stable runs."""
        return sum(bool(row["stable"]) for row in self.rows)

    @property
    def breaks(self) -> bool:
        """Whether a run was unstable, lost contact or was stopped."""
        return self.stable < len(self.rows)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why runs were stopped or not run, each reason once."""
        return tuple(dict.fromkeys(row["protective_stop"] for row in self.rows if row["protective_stop"]))


def summarize(cases: Sequence[Case], entries: Sequence[Entry], rows: Sequence[Row]) -> list[Summary]:
    """Summaries in the order of the cases, then of the controllers; what has no row is left out."""
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        found.setdefault((row["case"], row["controller"]), []).append(row)
    summaries = []
    for case in cases:
        for entry in entries:
            own = found.get((case.name, entry.label))
            if own:
                figures = {name: spread([row[name] for row in own]) for name in own[0] if name in _FIGURES}
                summaries.append(Summary(case, entry, tuple(own), figures))
    return summaries


def spread(values: Sequence[float | None]) -> Spread:
    """Mean of the values there are, and the largest if all of them are there."""
    known = [float(value) for value in values if value is not None]
    if not known:
        return Spread(None, None)
    return Spread(sum(known) / len(known), max(known) if len(known) == len(values) else None)


def worst_case(summaries: Sequence[Summary], entry: Entry) -> dict[str, Any] | None:
    """The case a controller does worst in: most unstable runs, then the largest error beside the wanted force.

    Returns:
        case, seed, stable, max_error_n and protective_stop of the worst run there; None without rows.
    """
    own = [summary for summary in summaries if summary.entry == entry]
    if not own:
        return None
    worst = max(own, key=lambda s: ((len(s.rows) - s.stable) / len(s.rows), max(map(_error_share, s.rows))))
    row = max(worst.rows, key=lambda r: (not r["stable"], _error_share(r)))
    names = ("case", "seed", "stable", "max_error_n", "protective_stop")
    return {name: row[name] for name in names}


def _error_share(row: Row) -> float:
    """Largest error; a run without one counts as worse than any."""
    return float("inf") if row["max_error_n"] is None else float(row["max_error_n"])


_FIGURES: Final = (*SHOWN, "mean_error_n", "std_n", "oscillation_n", "peaks_error_n")
