"""The score in words and tables: the same cells for the screen and for Markdown (layer 10)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from polish_sim.analysis.score_figures import DEFINITIONS
from polish_sim.scoring.case import Entry
from polish_sim.scoring.reach import Verdict
from polish_sim.scoring.score import Score
from polish_sim.scoring.summary import SHORT, SHOWN, Spread, Summary, summarize, worst_case

Table = tuple[list[str], list[list[str]]]
"""Headings and rows."""

NONE: Final = "-"


def number(value: float | None) -> str:
    """Three significant digits; a dash where there is none."""
    return NONE if value is None else f"{value:.3g}"


def overview(summaries: Sequence[Summary], means: bool = True) -> Table:
    """A row per case and controller: mean and worst of every figure, and how many runs were stable.

    Args:
        summaries: The summaries.
        means: Whether means are shown beside the worst, under headings with units.

    Returns:
        Headings and rows.
    """
    several = len({summary.entry for summary in summaries}) > 1
    headings = ["case", *(["controller"] if several else []), *(SHOWN.values() if means else SHORT), "stable"]
    rows, before = [], ""
    for summary in summaries:
        name = summary.case.name if summary.case.name != before else ""
        before = summary.case.name
        cells = [_cell(summary, figure, means) for figure in SHOWN]
        rows.append([name, *([summary.entry.label] if several else []), *cells, _stable(summary)])
    return headings, rows


def breaking(summaries: Sequence[Summary], entry: Entry) -> list[str]:
    """Where a controller breaks, a line per case."""
    lines = []
    for summary in summaries:
        if summary.entry == entry and summary.breaks:
            why = "; ".join(summary.reasons) or _weakness(summary)
            lines.append(
                f"{summary.case.name}: {len(summary.rows) - summary.stable} of {len(summary.rows)} runs, {why}"
            )
    return lines


def verdict_table(verdicts: Sequence[Verdict]) -> Table:
    """What was asked and what was measured: worst and mean over all runs, where the worst was."""
    headings = ["figure", "unit", "published", "asked", "worst", "mean", "runs", "least good run", "met"]
    rows = []
    for v in verdicts:
        shares = v.asked.figure == "stable"
        asked = "all" if shares else f"<= {v.asked.most:g}"
        worst = f"{100.0 * (v.worst or 0.0):.4g}%" if shares else ("never" if v.worst is None else number(v.worst))
        mean = NONE if shares else number(v.mean)
        last = [str(v.runs), v.worst_case or NONE, "yes" if v.met else "NO"]
        rows.append([v.asked.label, v.asked.unit, v.asked.published, asked, worst, mean, *last])
    return headings, rows


def worst_line(score: Score, entry: Entry) -> str:
    """The worst case of a controller in one line."""
    worst = worst_case(summarize(score.cases, score.entries, score.rows), entry)
    if worst is None:
        return f"{entry.label}: no rows"
    how = "" if worst["stable"] else f", {worst['protective_stop'] or 'not stable'}"
    error = "" if worst["max_error_n"] is None else f", error up to {number(worst['max_error_n'])} N"
    return f"{entry.label}: {worst['case']} (seed {worst['seed']}{error}{how})"


def markdown(score: Score, verdicts: Sequence[tuple[Entry, Sequence[Verdict]]]) -> str:
    """The whole score as a Markdown page."""
    summaries = summarize(score.cases, score.entries, score.rows)
    names = " and ".join(f"`{entry.label}`" for entry in score.entries)
    parts = [f"# Score of {names}", _intro(score)]
    parts += [f"Worst case of {worst_line(score, entry)}." for entry in score.entries]
    for entry, own in verdicts:
        if own:
            parts.append(f"## What is asked: `{entry.label}`\n\n{_grid(*verdict_table(own))}")
    parts.append(f"## All cases, mean / worst seed\n\n{_grid(*overview(summaries))}")
    for entry in score.entries:
        lines = breaking(summaries, entry)
        told = "\n".join(f"- {line}" for line in lines) if lines else "Nowhere in these cases."
        parts.append(f"## Where `{entry.label}` breaks\n\n{told}")
    parts.append("## Case by case")
    parts += [_case_part(score, summaries, index) for index in range(len(score.cases))]
    definitions = "\n".join(f"- **{name}**: {text}" for name, text in DEFINITIONS.items())
    parts.append(f"## Definitions\n\n{definitions}")
    return "\n\n".join(parts) + "\n"


def _intro(score: Score) -> str:
    missing = score.wanted - len(score.rows)
    told = f" **{missing} of {score.wanted} rows are missing.**" if missing else ""
    seeds = _count(score.seeds, "seed")
    return (
        f"{_count(len(score.rows), 'run')}, {seeds} per case; mean / worst over the seeds, exact contact force.{told}"
    )


def _count(number_of: int, thing: str) -> str:
    return f"{number_of} {thing}" if number_of == 1 else f"{number_of} {thing}s"


def _case_part(score: Score, summaries: Sequence[Summary], index: int) -> str:
    case = score.cases[index]
    own = [summary for summary in summaries if summary.case == case]
    headings = ["figure"] + [f"`{s.entry.label}` mean" for s in own] + [f"`{s.entry.label}` worst" for s in own]
    rows = []
    for figure, label in SHOWN.items():
        spreads = [s.figures.get(figure, Spread(None, None)) for s in own]
        cells = [number(s.mean) for s in spreads] + [_worst(s, figure, case.moving) for s in spreads]
        rows.append([label, *cells, *([_delta(*spreads)] if len(own) == 2 else [])])
    rows.append(["stable", *("" for _ in own), *(_stable(s) for s in own), *([""] if len(own) == 2 else [])])
    headings += ["worst, change"] if len(own) == 2 else []
    keys = ", ".join(f"`{setting}`" for setting in case.settings) or "the defaults"
    return f"### {case.name}\n\n{case.text}. `run {case.experiment}` with {keys}.\n\n{_grid(headings, rows)}"


def _cell(summary: Summary, figure: str, means: bool) -> str:
    spread = summary.figures.get(figure, Spread(None, None))
    worst = _worst(spread, figure, summary.case.moving)
    return f"{number(spread.mean)} / {worst}" if means and spread.mean is not None and len(summary.rows) > 1 else worst


def _worst(spread: Spread, figure: str, moving: bool) -> str:
    """The worst value; ``never`` where one is missing that is missing only in failed runs."""
    if spread.worst is not None or (figure == "settling_1n_s" and moving):
        return number(spread.worst)
    return "never" if figure == "settling_1n_s" else NONE


def _delta(first: Spread, second: Spread) -> str:
    """Change of the worst value from the second controller to the first."""
    if first.worst is None or second.worst is None:
        return NONE
    change = f"{first.worst - second.worst:+.3g}"
    return change if second.worst == 0.0 else f"{change} ({100.0 * (first.worst / second.worst - 1.0):+.0f}%)"


def _stable(summary: Summary) -> str:
    return f"{summary.stable}/{len(summary.rows)}"


def _weakness(summary: Summary) -> str:
    lost = summary.figures["contact_lost_s"].mean or 0.0
    swing = summary.figures["oscillation_n"].worst or 0.0
    return f"contact lost for {number(lost)} s on average, oscillation up to {number(swing)} N"


def _grid(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [headings, ["---", *("---:" for _ in headings[1:])], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
