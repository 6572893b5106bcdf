"""`polish-sim score`: the fixed battery for one controller, or for two side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE, SHORT
from polish_sim.cli.many import filled
from polish_sim.cli.options import OWN, Given, Own, refuse_beside, takes
from polish_sim.config.key import OUTPUT, RUN
from polish_sim.errors import count_text
from polish_sim.experiments.registry import once_more
from polish_sim.page import Table, save_page
from polish_sim.row_file import METRICS, Row, Rows, package_versions, put_file, save_plots, write_json
from polish_sim.scenario_file import counted_seeds, to_toml

if TYPE_CHECKING:
    from polish_sim.scoring import Score, Task
    from polish_sim.scoring.border import Border
    from polish_sim.scoring.figures import Asked
    from polish_sim.scoring.summary import Verdicts

SEEDS = 5
SEEDS_OF_REACH = 20
OF_CASES = ("--seed", "--seeds", "--case", "--reach", "--list", "--check")
"""Options that count only where cases of a score are measured."""
CONTROLLER_TEXT = (
    "A shipped controller (see 'list'; default hybrid-pi), FILE.py:CLASS, or a policy: FILE.npz:linear, "
    "FILE.zip:sb3. A .py or .zip file runs code."
)


@takes(
    Own("--controller", RUN, "NAME", CONTROLLER_TEXT),
    Own("--against", RUN, "NAME", "A second controller, to put beside it."),
    OWN["--seeds"]._replace(text="Seeds per case, counting up from --seed; default 5, with --reach 20."),
    Own("--case", RUN, "NAME", "Only this case, or pattern such as 'latency-*'; may be repeated.", list),
    Own("--reach", RUN, "", "The cases behind the figures asked, instead of the battery."),
    Own("--ablate", RUN, "", "Leave out one law of the controller after the other."),
    Own("--border", RUN, "", "Search springs and latencies up to which it stays stable, instead of scoring."),
    Own(
        "--worst",
        RUN,
        "N",
        "Search with N runs for the largest force, loss of contact and error, instead of scoring; "
        "the config of each worst run is kept.",
        int,
        30,
        1e6,
    ),
    Own("--list", RUN, "", "List the cases and what is run in each."),
    OWN["--set"]._replace(text="KEY=VALUE of the config for --controller; may be repeated."),
    *("--seed", "--check", "--workers", "--on", "--out"),
    Own("--overwrite", OUTPUT, "", "Replace another score in --out; runs that both have are kept."),
)
def score(given: Given) -> int:
    """Score a controller by a fixed battery of cases under realistic disturbances; Ctrl-C keeps what is
    done."""
    against, settings = given["--against"], given["--set"] or []
    refuse_beside(given, "--ablate", "--against")
    refuse_beside(given, "--worst", *OF_CASES, "--ablate", "--against", "--border")
    refuse_beside(given, "--border", *OF_CASES, "--ablate")
    from polish_sim.experiments.assembly import user_files
    from polish_sim.scoring import (
        BATTERY,
        REACH_CASES,
        ablations,
        asked_for,
        check_entries,
        choose_cases,
        list_tasks,
        run_score,
        user_entry,
    )  # fmt: skip

    reach = bool(given["--reach"])
    cases = choose_cases(REACH_CASES if reach else BATTERY, given["--case"] or [])
    if given["--list"]:
        named = [[c.name, c.text] for c in cases]
        console.table(Table("cases of the score", ["case", "what is run"], named, left=2))
        return DONE
    own = user_entry(given["--controller"] or "hybrid-pi", settings, "with --set" if settings else "")
    entries = (
        [own, *ablations(own)]
        if given["--ablate"]
        else [own, *([user_entry(against)] if against is not None else [])]
    )
    check_entries(cases, entries)
    seeds = counted_seeds(given["--seed"], given["--seeds"] or (SEEDS_OF_REACH if reach else SEEDS))
    what, more = "score", {"cases": [case.name for case in cases], **_seeds_of(seeds)}
    tasks = list_tasks(cases, entries, seeds)
    work: Callable[..., Any] = partial(run_score, cases, entries, seeds)
    show: Callable[..., int] = partial(write_and_show, given)
    if given["--border"]:
        from polish_sim.scoring.border import border_tasks, measure_border

        what, more, tasks = "border", {}, [task for entry in entries for task in border_tasks(entry)]
        work, show = partial(measure_border, entries), show_border
    elif given["--worst"]:
        from polish_sim.scoring.worst import first_tasks, search_worst

        what, more, tasks = "search of the worst", {}, first_tasks(own)
        work, show = partial(search_worst, own, given["--worst"]), show_worst
    asked = asked_for(what, entries, tasks, **more)
    stage = f"{what}: {', '.join(entry.label for entry in entries)}"
    one_each = {task.entry: task.scenario for task in tasks}.values()
    files = [file for scenario in one_each for file in user_files(scenario)]
    with filled(given, "score", asked, stage, lambda at: (Rows(at), work), files) as (folder, found):
        return show(found, folder)


def show_worst(rows: Mapping[Task, Row], folder: Path) -> int:
    """Print the worst runs of a search with the commands that repeat them, and keep their configs."""
    from polish_sim.scoring.worst import FIGURES, size_of

    shown: list[Sequence[str]] = []
    figures: dict[str, float] = {}
    for (name, figure), label, unit in zip(
        FIGURES.items(), ("largest force", "contact lost", "largest error"), "NsN", strict=True
    ):
        task = max(rows, key=lambda task: size_of(rows[task], figure))
        drawn, figures[name] = task.scenario, size_of(rows[task], figure)
        put_file(folder, f"{name}.toml", to_toml(drawn))
        where = (
            f"{drawn.part.file}, springs x {drawn.head.spring_scale:g}, "
            f"{1e3 * drawn.process.feed_m_s:.3g} mm/s"
        )
        stopped = (rows[task]["protective_stop"] or "").partition(":")[0]
        shown.append([label, unit, f"{figures[name]:.3g}", where, stopped])
    stops = sum(bool(row["protective_stop"]) for row in rows.values())
    write_json(folder / METRICS, {**figures, "runs": len(rows), "stops": stops})
    title = f"worst of {task.entry.label}, {count_text(len(rows), 'run')}, {stops} stopped"
    console.table(Table(title, ["figure", "unit", "worst", "where", "stopped, as"], shown))
    for name in FIGURES:
        console.say(f"to repeat: polish-sim run surface --config {folder / name}.toml")
    console.say_folder(folder)
    return DONE


def write_and_show(given: Given, score: Score, folder: Path) -> int:
    """Write and print the results of a score; returns 1 only with ``--check``, 130 if it was interrupted."""
    from polish_sim.scoring import BATTERY_ASKED, REACH, judge, score_notes, score_tables

    asked = REACH if given["--reach"] else BATTERY_ASKED
    verdicts = [(entry, judge(asked, score.rows_of(entry))) for entry in score.entries]
    _write(folder, given, score, verdicts, asked)
    for table in score_tables(score, verdicts, bool(given["--ablate"]), means=False):
        console.table(table)
    for line in score_notes(score):
        console.say(line)
    console.say_folder(folder)
    short = any(not verdict.met for verdict in verdicts[0][1]) or len(score.rows) < score.wanted
    return SHORT if given["--check"] and short else DONE


def _write(folder: Path, given: Given, score: Score, verdicts: Verdicts, limits: Sequence[Asked]) -> None:
    from polish_sim.page.page import Page
    from polish_sim.scoring import about_score, markdown, score_notes, score_tables
    from polish_sim.scoring.figures import DEFINITIONS
    from polish_sim.scoring.plot import plot_score

    facts = _facts(score)
    asked = {
        entry.label: [
            {
                "figure": v.claim.label,
                "asked": v.claim.high,
                "worst": v.worst,
                "mean": v.mean,
                "met": v.met,
            }
            for v in own
        ]
        for entry, own in verdicts
    }
    cases = {
        case.name: {
            "text": case.text,
            "experiment": case.experiment,
            "settings": case.settings,
            "drawn": [draw._asdict() for draw in case.draws],
        }
        for case in score.cases
    }
    whole: dict[str, Any] = {
        **facts, "cases": cases, "asked": asked, "rows": score.rows, "versions": package_versions(),
        "definitions": DEFINITIONS,
    }  # fmt: skip
    write_json(folder / "score.json", whole)
    write_json(folder / METRICS, facts | {"asked": asked})
    tables = score_tables(score, verdicts, bool(given["--ablate"]))
    put_file(folder, "score.md", markdown(score, tables))
    named = ", ".join(entry.label for entry in score.entries)
    page = Page.of(f"score: {named}", about_score(score), [*tables, _worst_runs(score)], score_notes(score))
    save_page(folder, page)
    moving = {case.name: case.moving for case in score.cases}
    save_plots(folder, {"score.png": plot_score(score.rows, moving, limits)})


def _seeds_of(seeds: range) -> dict[str, int]:
    return {"first_seed": seeds.start, "seeds": len(seeds)}


def _facts(score: Score) -> dict[str, Any]:
    from polish_sim.scoring import breaking, summarize, worst_case

    summaries = summarize(score)
    return {
        "controllers": [entry.label for entry in score.entries],
        "cases": [case.name for case in score.cases],
        **_seeds_of(score.seeds),
        "worst_case": {entry.label: worst_case(summaries, entry) for entry in score.entries},
        "breaks": {entry.label: breaking(summaries, entry) for entry in score.entries},
        "runs": len(score.rows),
        "runs_missing": score.wanted - len(score.rows),
    }


def _worst_runs(score: Score) -> Table:
    """The command that plays the worst run of each case and leaves its own page."""
    from polish_sim.scoring import summarize, worst_case

    runs = []
    for summary in summarize(score):
        worst = worst_case([summary], summary.entry)
        if worst:
            scenario = summary.case.scenario(summary.entry, worst["seed"])
            command = once_more(scenario)
            runs.append([summary.case.name, summary.entry.label, str(worst["seed"]), command])
    return Table("look at one", ["case", "controller", "seed", "the worst run, with a page of its own"], runs)


# The border of stability.


def show_border(border: Border, folder: Path) -> int:
    """Draw and show the border of stability, in the cell and in the linear model."""
    from polish_sim.scoring.border import plot_border

    facts = _border_facts(border)
    write_json(folder / "border.json", facts | {"versions": package_versions()})
    save_plots(folder, {"border.png": plot_border(border)})
    for label, found in facts["controllers"].items():
        headings = ["springs", "in the cell [ms]", "linear model [ms]"]
        console.table(Table(f"stable up to this latency, {label}", headings, _border_rows(found, border)))
    console.say_folder(folder)
    return DONE


def _border_facts(border: Border) -> dict[str, Any]:
    """What each run did, and the longest latency that is stable by scale of the springs."""
    import numpy as np

    controllers = {}
    for name, rests in border.rests.items():
        stable = [[rest.stable for rest in row] for row in rests]
        line = np.interp(np.log(border.scales), np.log(border.line_scales), border.lines[name])
        controllers[name] = {
            "stable": stable,
            "at_rest": [[rest.resting for rest in row] for row in rests],
            "swing_n": [[rest.swing for rest in row] for row in rests],
            "latency_stable_s": [_longest(border, column) for column in zip(*stable, strict=True)],
            "latency_stable_model_s": line,
        }
    return {"spring_scales": border.scales, "latencies_s": border.latencies, "controllers": controllers}


def _longest(border: Border, stable: Sequence[bool | None]) -> float | None:
    """The longest latency up to which every run was stable [s]; None if already the shortest was not."""
    known = takewhile(lambda run: run[1] is not False, zip(border.latencies.tolist(), stable, strict=True))
    return max((latency for latency, held in known if held), default=None)


def _border_rows(found: dict[str, Any], border: Border) -> list[list[str]]:
    rows = []
    limits = (found[f"latency_stable_{of}"] for of in ("s", "model_s"))
    columns = zip(*found["stable"], strict=True)
    for scale, cell, model, runs in zip(border.scales, *limits, columns, strict=True):
        least, none = ("", "none") if False in runs else (">= ", "-")
        shown = none if cell is None else f"{least}{1e3 * cell:.0f}"
        rows.append([f"{scale:g} x", shown, f"{1e3 * model:.0f}" if math.isfinite(model) else "-"])
    return rows
