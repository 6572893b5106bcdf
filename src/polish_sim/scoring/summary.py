"""Many rows in few numbers: per case and controller the mean and the worst over the seeds."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from polish_sim.analysis.claim import bound_text
from polish_sim.errors import InputError, count_text
from polish_sim.experiments import default_scenario
from polish_sim.page import Table, number_or_dash
from polish_sim.row_file import Row
from polish_sim.scenario_file import override
from polish_sim.scoring.battery import Case, Entry
from polish_sim.scoring.figures import DEFINITIONS, JudgedFigure, Spread, spread
from polish_sim.scoring.score import Score

Verdicts = Sequence[tuple[Entry, Sequence[JudgedFigure]]]
SHOWN: Mapping[str, str] = {
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


def summarize(score: Score) -> list[Summary]:
    """Summaries in the order of the cases, then of the controllers; what has no row is left out."""
    found: dict[tuple[str, str], list[Row]] = {}
    for row in score.rows:
        found.setdefault((row["case"], row["controller"]), []).append(row)
    summaries = []
    for case in score.cases:
        for entry in score.entries:
            own = found.get((case.name, entry.label))
            if own:
                figures = {name: spread([row[name] for row in own]) for name in own[0] if name in _FIGURES}
                summaries.append(Summary(case, entry, tuple(own), figures))
    return summaries


def worst_case(summaries: Sequence[Summary], entry: Entry) -> dict[str, Any] | None:
    """The case a controller does worst in: most unstable runs, then the largest error beside the wanted
    force.

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


_FIGURES = (*SHOWN, "mean_error_n", "std_n", "oscillation_n", "peaks_error_n")


def score_tables(score: Score, verdicts: Verdicts, ablated: bool = False, means: bool = True) -> list[Table]:
    """A score: all cases, what each law is worth if all controllers but the first lack one (``ablated``),
    what is asked.

    ``means``: with the mean of every figure and the places of the worst, which the screen has no room for.
    """
    tables = [overview(summarize(score), means)]
    if ablated:
        tables.append(ablation_table(score, means))
    return tables + [verdict_table(entry, own) for entry, own in verdicts[: 1 if ablated else None] if own]


def overview(summaries: Sequence[Summary], means: bool) -> Table:
    """A row per case and controller: worst of every figure, if asked its mean, and how many runs were
    stable."""
    several = len({summary.entry for summary in summaries}) > 1
    names = [label if means else label.partition(" [")[0] for label in SHOWN.values()]
    headings = ["case", *(["controller"] if several else []), *names, "stable"]
    rows, before = [], ""
    for summary in summaries:
        name = summary.case.name if summary.case.name != before else ""
        before = summary.case.name
        cells = [_cell(summary, figure, means) for figure in SHOWN]
        cells.append(f"{summary.stable}/{len(summary.rows)}")
        rows.append([name, *([summary.entry.label] if several else []), *cells])
    title = "all cases, mean / worst seed" if means else "all cases, worst seed [s, N]; means in score.md"
    return Table(title, headings, rows, 1 + several)


def breaking(summaries: Sequence[Summary], entry: Entry) -> list[str]:
    """Where a controller breaks, a line per case."""
    lines = []
    for summary in summaries:
        if summary.entry == entry and summary.breaks:
            why = "; ".join(summary.reasons) or _weakness(summary)
            lines.append(
                f"{summary.case.name}: {len(summary.rows) - summary.stable} of {len(summary.rows)} runs, "
                f"{why}"
            )
    return lines


def verdict_table(entry: Entry, verdicts: Sequence[JudgedFigure]) -> Table:
    """What was asked of a controller and what was measured: worst and mean over all runs, where the worst
    was."""
    headings = ["figure", "unit", "published", "asked", "worst", "mean", "runs", "least good run", "met"]
    rows = []
    for v in verdicts:
        claim, shares = v.claim, v.claim.figure == "stable"
        asked = "all" if shares else bound_text(claim)
        worst = (
            f"{100.0 * (v.worst or 0.0):.4g}%"
            if shares
            else ("never" if v.worst is None else number_or_dash(v.worst))
        )
        mean = "-" if shares else number_or_dash(v.mean)
        last = [str(v.runs), v.worst_case or "-", "yes" if v.met else "NO"]
        rows.append([claim.label, claim.unit, claim.paper, asked, worst, mean, *last])
    return Table(f"what is asked: {entry.label}", headings, rows)


def worst_line(score: Score, entry: Entry) -> str:
    """The worst case of a controller in one line."""
    worst = worst_case(summarize(score), entry)
    if worst is None:
        return f"{entry.label}: no rows"
    how = "" if worst["stable"] else f", {worst['protective_stop'] or 'not stable'}"
    error = "" if worst["max_error_n"] is None else f", error up to {number_or_dash(worst['max_error_n'])} N"
    return f"{entry.label}: {worst['case']} (seed {worst['seed']}{error}{how})"


def score_notes(score: Score) -> list[str]:
    """The worst case of each controller, and where it breaks."""
    summaries = summarize(score)
    return [
        line
        for entry in score.entries
        for line in (
            f"worst case of {worst_line(score, entry)}",
            *(f"  breaks in {case}" for case in breaking(summaries, entry)),
        )
    ]


def about_score(score: Score) -> str:
    """How many runs there are and what their figures are."""
    missing = score.wanted - len(score.rows)
    note = f" {missing} of {score.wanted} rows are missing." if missing else ""
    runs, seeds = count_text(len(score.rows), "run"), count_text(len(score.seeds), "seed")
    first = f"{seeds} per case from {score.seeds.start} on"
    return f"{runs}, {first}; mean / worst over the seeds, exact contact force.{note}"


def markdown(score: Score, tables: Iterable[Table]) -> str:
    """The whole score as a Markdown page."""
    names = ", ".join(entry.label for entry in score.entries)
    cases = [[case.name, case.text, case.experiment, " ".join(case.settings)] for case in score.cases]
    definitions = "\n".join(f"- **{name}**: {text}" for name, text in DEFINITIONS.items())
    parts = [f"# Score of {names}", about_score(score), "\n".join(f"- {note}" for note in score_notes(score))]
    described = Table("Cases", ["case", "what is run", "experiment", "settings"], cases)
    parts += [table.markdown for table in (*tables, described)]
    return "\n\n".join([*parts, f"## Definitions\n\n{definitions}"]) + "\n"


def _cell(summary: Summary, figure: str, means: bool) -> str:
    spread = summary.figures.get(figure, Spread(None, None))
    worst = _worst(spread, figure, summary.case.moving)
    return (
        f"{number_or_dash(spread.mean)} / {worst}"
        if means and spread.mean is not None and len(summary.rows) > 1
        else worst
    )


def _worst(spread: Spread, figure: str, moving: bool) -> str:
    """The worst value; ``never`` where one is missing that is missing only in failed runs."""
    if spread.worst is not None or (figure == "settling_1n_s" and moving):
        return number_or_dash(spread.worst)
    return "never" if figure == "settling_1n_s" else "-"


def _weakness(summary: Summary) -> str:
    lost = summary.figures["contact_lost_s"].mean or 0.0
    swing = summary.figures["oscillation_n"].worst or 0.0
    return (
        f"contact lost for {number_or_dash(lost)} s on average, oscillation up to {number_or_dash(swing)} N"
    )


# What each law of a composed controller is worth: the battery with one of them left out at a time.

COMPOSED = "hybrid-adaptive"  #: The controller whose laws can be left out
KEY = "controller.adaptive.laws"

_ABLATION_KEYS = {
    name: SHOWN[name] for name in ("settling_1n_s", "overshoot_n", "rms_error_n", "max_error_n", "slowed")
}
_WITHOUT = "without "
_NOTHING = 5e-4  # a smaller change counts as zero


def ablations(entry: Entry) -> list[Entry]:
    """The controller without one of its laws, once for each; InputError if it has none that could be left
    out."""
    laws = _laws(entry)
    return [
        Entry(
            f"{_WITHOUT}{law}",
            entry.name,
            (*entry.settings, f"{KEY}={' '.join(other for other in laws if other != law)}"),
        )
        for law in laws
    ]


def ablation_table(score: Score, places: bool = True) -> Table:
    """For each law: how much each figure grows without it, on average and in the case it grows most (named if
    asked).

    ``score``: its first controller is the whole one and the others lack a law each.
    """
    summaries = summarize(score)
    whole, *others = score.entries
    known = {summary.case.name: summary for summary in summaries if summary.entry == whole}
    rows = []
    for entry in others:
        own = [summary for summary in summaries if summary.entry == entry]
        pairs = [(known[one.case.name], one) for one in own if one.case.name in known]
        changes = (_told(_changes(pairs, figure), places) for figure in _ABLATION_KEYS)
        more = sum(before.stable - after.stable for before, after in pairs)
        rows.append([entry.label.removeprefix(_WITHOUT), *changes, f"{more:+d}"])
    title = f"what each law of {whole.label} is worth: mean change without it and the largest"
    return Table(title, ["law left out", *_ABLATION_KEYS.values(), "unstable runs"], rows)


def _changes(pairs: Iterable[tuple[Summary, Summary]], figure: str) -> dict[str, float]:
    """How much the mean of a figure grows without a law, by case, where both means are known."""
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
    return number_or_dash(value if abs(value) >= _NOTHING else 0.0, "+.3g")


def _laws(entry: Entry) -> list[str]:
    if entry.name != COMPOSED:
        raise InputError(f"--ablate leaves out laws of '{COMPOSED}'; '{entry.label}' is not composed of any.")
    config: Any = override(default_scenario("force"), list(entry.settings)).controller
    laws = [law for law in re.split(r"[\s,]+", str(config.adaptive.laws)) if law]
    if not laws:
        raise InputError(f"{KEY} is empty: there is no law to leave out.")
    return laws
