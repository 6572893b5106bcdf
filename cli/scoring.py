"""Runs a score with a bar, writes its folder and tells what came out; imported only inside the command."""

from __future__ import annotations

import io
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from polish_sim.analysis.run_record import package_versions
from polish_sim.cli import console
from polish_sim.cli.boundary import DONE, INTERRUPTED, SHORT
from polish_sim.cli.compiling import FIRST_START
from polish_sim.cli.progress import QUIET_S
from polish_sim.cli.score_folder import put
from polish_sim.kernel_cache import is_warm
from polish_sim.scoring import (
    BATTERY_ASKED,
    REACH,
    Case,
    Entry,
    Score,
    Verdict,
    ablation_ratios,
    ablation_table,
    breaking,
    judge,
    markdown,
    overview,
    run_score,
    summarize,
    verdict_table,
    worst_case,
    worst_line,
)
from polish_sim.scoring.figures import DEFINITIONS
from polish_sim.scoring.plot import Limit, plot_ablation, plot_score


@dataclass(frozen=True)
class Wish:
    """What is to be scored."""

    cases: tuple[Case, ...]
    entries: tuple[Entry, ...]
    seeds: int
    reach: bool
    ablate: bool
    workers: int | None


def score_and_tell(wish: Wish, folder: Path, check: bool) -> int:
    """Score, write the folder, which is locked, and print the tables.

    Returns:
        The exit code: 1 only with ``check``; 130 when it was interrupted.
    """
    console.note(f"folder: {folder} (the same command with --out {folder} continues a score that was broken off)")
    score = _run(wish, folder)
    verdicts = [(entry, judge(REACH if wish.reach else BATTERY_ASKED, score.rows_of(entry))) for entry in wish.entries]
    _write(folder, wish, score, verdicts)
    _tell(wish, score, verdicts)
    console.say(f"folder: {folder}")
    if score.interrupted:
        console.note("interrupted: the rows above are kept; the same command with --out continues.")
        return INTERRUPTED
    short = any(not verdict.met for verdict in verdicts[0][1]) or not score.complete
    return SHORT if check and short else DONE


def _run(wish: Wish, folder: Path) -> Score:
    if not is_warm():
        console.note(FIRST_START)
    with console.progress() as observer:
        observer.stage(f"score {', '.join(e.label for e in wish.entries)}: {len(wish.cases)} cases")
        bar, told_at = sys.stderr.isatty(), -math.inf

        def heard(done: int, total: int, trouble: str | None) -> None:
            nonlocal told_at
            if trouble is not None:
                console.note(f"warning: {trouble}.")
            if bar:
                observer.progress(done, total)
            elif done == total or time.monotonic() - told_at >= QUIET_S:
                console.note(f"{done} of {total} runs")
                told_at = time.monotonic()

        return run_score(wish.cases, wish.entries, wish.seeds, folder, heard, wish.workers)


def _write(folder: Path, wish: Wish, score: Score, verdicts: Sequence[tuple[Entry, Sequence[Verdict]]]) -> None:
    facts = _facts(score)
    asked = {
        entry.label: [
            {"figure": v.asked.label, "asked": v.asked.most, "worst": v.worst, "mean": v.mean, "met": v.met}
            for v in own
        ]
        for entry, own in verdicts
    }
    cases = {
        case.name: {
            "text": case.text,
            "experiment": case.experiment,
            "settings": list(case.settings),
            "drawn": [draw._asdict() for draw in case.draws],
        }
        for case in score.cases
    }
    whole: dict[str, Any] = {
        **facts, "cases": cases, "asked": asked, "rows": list(score.rows), "versions": package_versions(),
        "definitions": dict(DEFINITIONS),
    }  # fmt: skip
    put(folder, "score.json", json.dumps(whole, indent=1, allow_nan=False) + "\n")
    put(folder, "metrics.json", json.dumps(facts | {"asked": asked}, indent=2, allow_nan=False) + "\n")
    page = markdown(score, verdicts)
    if wish.ablate:
        page += _ablation_page(wish, score)
    put(folder, "score.md", page)
    if score.rows and wish.ablate:
        put(folder, "score.png", png_of(plot_ablation(ablation_ratios(score))))
    elif score.rows:
        moving = {case.name: case.moving for case in score.cases}
        limits = [
            Limit(case.name, asked.figure, asked.most)
            for asked in (REACH if wish.reach else BATTERY_ASKED)
            for case in score.cases
            if asked.applies(case.name)
        ]
        put(folder, "score.png", png_of(plot_score(score.rows, moving, limits)))


def _facts(score: Score) -> dict[str, Any]:
    summaries = summarize(score.cases, score.entries, score.rows)
    return {
        "controllers": [entry.label for entry in score.entries],
        "cases": [case.name for case in score.cases],
        "seeds": score.seeds,
        "worst_case": {entry.label: worst_case(summaries, entry) for entry in score.entries},
        "breaks": {entry.label: breaking(summaries, entry) for entry in score.entries},
        "runs": len(score.rows),
        "runs_missing": score.wanted - len(score.rows),
    }


def _tell(wish: Wish, score: Score, verdicts: Sequence[tuple[Entry, Sequence[Verdict]]]) -> None:
    summaries = summarize(score.cases, score.entries, score.rows)
    if not score.rows:
        return
    left = 2 if len(score.entries) > 1 else 1
    seeds = f"worst of {score.seeds} seeds (means in score.md)" if score.seeds > 1 else "one seed"
    console.table(f"score [s, N], {seeds}", *overview(summaries, means=False), left=left)
    if wish.ablate:
        console.table("without each law: mean change and largest [s, N]", *ablation_table(score, places=False))
    for entry, own in verdicts if not wish.ablate else verdicts[:1]:
        if own:
            console.table(f"what is asked: {entry.label}", *verdict_table(own))
    for entry in score.entries:
        console.say(f"worst case of {worst_line(score, entry)}")
        for line in breaking(summaries, entry):
            console.say(f"  breaks in {line}")


def _ablation_page(wish: Wish, score: Score) -> str:
    headings, rows = ablation_table(score)
    lines = [headings, ["---"] * len(headings), *rows]
    grid = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return f"\n## What each law of `{wish.entries[0].label}` is worth\n\n{grid}\n"


def png_of(figure: Figure) -> bytes:
    """A figure as the bytes of a PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
