"""`polish-sim score`: the fixed battery for one controller, or for two side by side."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE, INTERRUPTED, SHORT
from polish_sim.cli.options import OWN, Given, Own, takes
from polish_sim.cli.output_folder import claimed, rows_folder
from polish_sim.config.key import CONFIG, OUTPUT, RUN
from polish_sim.errors import InputError, count_text
from polish_sim.page import PAGE
from polish_sim.row_file import ROWS, locked, whole_file

if TYPE_CHECKING:
    from polish_sim.scoring import Case, Entry, Score, Verdict

SEEDS: Final = 5
SEEDS_OF_REACH: Final = 20
CONTROLLER_TEXT: Final = (
    "A shipped controller (see 'list'; default hybrid-pi), FILE.py:CLASS, or a policy: FILE.npz:linear, FILE.zip:sb3. "
    "A .py or .zip file runs code."
)
ASKED: Final = "asked.json"  #: What the score in the folder is of


@takes(
    Own("--controller", RUN, "NAME", CONTROLLER_TEXT),
    Own("--against", RUN, "NAME", "A second controller, to put beside it."),
    Own("--seeds", RUN, "N", "Seeds per case, counting up from 0; default 5, with --reach 20.", int, 1, 1e6),
    Own("--case", RUN, "NAME", "Only this case, or pattern such as 'latency-*'; may be repeated.", list),
    Own("--reach", RUN, "", "The cases behind the figures asked, instead of the battery.", bool),
    Own("--ablate", RUN, "", "Leave out one law of the controller after the other.", bool),
    Own("--border", RUN, "", "Search springs and latencies up to which it stays stable, instead of scoring.", bool),
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
    Own("--list", RUN, "", "List the cases and what is run in each.", bool),
    OWN["--check"],
    Own("--set", CONFIG, "KEY=VALUE", "KEY=VALUE of the config for --controller; may be repeated.", list),
    OWN["--workers"],
    OWN["--on"],
    Own("--out", OUTPUT, "DIR", "Folder; the same score begun there is continued. Default results/score/...", Path),
    Own("--overwrite", OUTPUT, "", "Replace another score in --out; runs that both have are kept.", bool),
)
def score(given: Given) -> int:
    """Score a controller by a fixed battery of cases under realistic disturbances; Ctrl-C keeps what is done."""
    against, ablate, settings = given["--against"], bool(given["--ablate"]), given["--set"] or []
    if ablate and against is not None:
        raise InputError("--ablate compares a controller with itself: leave --against out.")
    if given["--worst"]:
        return find_worst(given)
    # Lazy: --help must not wait for the numerical libraries.
    from polish_sim.scoring import BATTERY, REACH_CASES, ablations, asked_for, check_entries, choose_cases, user_entry

    reach, out, overwrite = bool(given["--reach"]), given["--out"], bool(given["--overwrite"])
    cases = choose_cases(REACH_CASES if reach else BATTERY, given["--case"] or [])
    if given["--list"]:
        console.table("cases of the score", ["case", "what is run"], [[c.name, c.text] for c in cases], left=2)
        return DONE
    own = user_entry(given["--controller"] or "hybrid-pi", settings, "with --set" if settings else "")
    entries = [own, *ablations(own)] if ablate else [own, *([user_entry(against)] if against is not None else [])]
    check_entries(cases, entries)
    if given["--border"]:
        from polish_sim.cli.border import search_border

        if settings or ablate:
            raise InputError("--border takes controllers as they ship: leave --set and --ablate out.")
        with open_folder(out, {"of": "border", "controllers": [entry.label for entry in entries]}, overwrite) as folder:
            return search_border(entries, folder)
    seeds = given["--seeds"] or (SEEDS_OF_REACH if reach else SEEDS)
    request = Request(cases, tuple(entries), seeds, reach, ablate, given["--workers"], given["--on"] or "local")
    with open_folder(out, asked_for(cases, entries, seeds), overwrite) as folder:
        return run_and_show(request, folder, bool(given["--check"]))


def find_worst(given: Given) -> int:
    """Search the worst runs of a controller, print them with the commands that repeat them, and keep their configs."""
    idle = [name for name in ("--against", "--seeds", "--case", "--reach", "--ablate", "--border") if given[name]]
    if idle:
        raise InputError(f"--worst searches one controller: leave {', '.join(idle)} out.")
    from polish_sim.analysis.run_record import write_json
    from polish_sim.scenario_file import override, to_toml
    from polish_sim.scoring.worst import FIGURES, search_worst, worst_base

    scenario = override(worst_base(given["--controller"] or "hybrid-pi"), given["--set"] or [])
    with claimed(given["--out"], "score-worst", bool(given["--overwrite"])) as folder:
        with console.progress() as observer:
            observer.stage(f"search the worst of {scenario.controller.label}")
            worst = search_worst(scenario, given["--worst"], observer.progress)
        if not worst.found:
            raise KeyboardInterrupt
        for name in FIGURES:
            (folder.draft / f"{name}.toml").write_text(to_toml(worst.found[name].scenario), encoding="utf-8")
        values = {name: found.value for name, found in worst.found.items()}
        write_json(folder.draft / "metrics.json", {**values, "runs": worst.runs, "stops": worst.stops})
    rows = []
    for name, label, unit in zip(FIGURES, ("largest force", "contact lost", "largest error"), "NsN", strict=True):
        found = worst.found[name]
        drawn = found.scenario
        where = f"{drawn.part.file}, springs x {drawn.head.spring_scale:g}, {1e3 * drawn.process.feed_m_s:.3g} mm/s"
        rows.append([label, unit, f"{found.value:.3g}", where, found.stopped.partition(":")[0]])
    console.table(f"worst of {scenario.controller.label}, {count_text(worst.runs, 'run')}, {worst.stops} stopped",
                  ["figure", "unit", "worst", "where", "stopped, as"], rows)  # fmt: skip
    for name in FIGURES:
        console.say(f"to repeat: polish-sim run surface --config {folder.final / name}.toml")
    console.say_folder(folder.final)
    return DONE if worst.runs == given["--worst"] else INTERRUPTED


@dataclass(frozen=True)
class Request:
    """What is to be scored."""

    cases: tuple[Case, ...]
    entries: tuple[Entry, ...]
    seeds: int
    reach: bool
    ablate: bool
    workers: int | None
    on: str = "local"


def run_and_show(request: Request, folder: Path, check: bool) -> int:
    """Score, write the locked folder, print the tables; returns 1 only with ``check``, 130 if it was interrupted."""
    from polish_sim.scoring import BATTERY_ASKED, REACH, judge

    console.note(f"folder: {folder} (the same command with --out {folder} resumes an interrupted score)")
    score = _run(request, folder)
    verdicts = [
        (entry, judge(REACH if request.reach else BATTERY_ASKED, score.rows_of(entry))) for entry in request.entries
    ]
    _write(folder, request, score, verdicts)
    _show(request, score, verdicts)
    console.say_folder(folder)
    if score.interrupted:
        console.note("interrupted: the rows above are kept; the same command with --out continues.")
        return INTERRUPTED
    short = any(not verdict.met for verdict in verdicts[0][1]) or not score.complete
    return SHORT if check and short else DONE


def _run(request: Request, folder: Path) -> Score:
    from polish_sim.cli.compiling import FIRST_START
    from polish_sim.cli.progress import QUIET_S
    from polish_sim.kernel_cache import is_warm
    from polish_sim.scoring import run_score
    from polish_sim.workers import open_workers

    if not is_warm():
        console.note(FIRST_START)
    with console.progress() as observer:
        observer.stage(f"score {', '.join(e.label for e in request.entries)}: {count_text(len(request.cases), 'case')}")
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

        files = [file for entry in request.entries if (file := Path(entry.name.rpartition(":")[0])).is_file()]
        with open_workers(request.on, request.workers, files) as workers:
            return run_score(request.cases, request.entries, request.seeds, folder, heard, workers)


def _write(folder: Path, request: Request, score: Score, verdicts: Sequence[tuple[Entry, Sequence[Verdict]]]) -> None:
    from polish_sim.analysis.run_record import package_versions
    from polish_sim.experiments.report import save_plots
    from polish_sim.scoring import BATTERY_ASKED, REACH, ablation_ratios, markdown
    from polish_sim.scoring.figures import DEFINITIONS
    from polish_sim.scoring.plot import plot_ablation, plot_score

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
    if request.ablate:
        page += _ablation_page(request, score)
    put(folder, "score.md", page)
    put(folder, PAGE, _page(request, score, verdicts))
    if score.rows and request.ablate:
        save_plots(folder, {"score.png": plot_ablation(ablation_ratios(score))})
    elif score.rows:
        moving = {case.name: case.moving for case in score.cases}
        figure = plot_score(score.rows, moving, REACH if request.reach else BATTERY_ASKED)
        save_plots(folder, {"score.png": figure})


def _facts(score: Score) -> dict[str, Any]:
    from polish_sim.scoring import breaking, summarize, worst_case

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


def _show(request: Request, score: Score, verdicts: Sequence[tuple[Entry, Sequence[Verdict]]]) -> None:
    from polish_sim.scoring import ablation_table, breaking, overview, summarize, verdict_table, worst_line

    summaries = summarize(score.cases, score.entries, score.rows)
    if not score.rows:
        return
    left = 2 if len(score.entries) > 1 else 1
    seeds = f"worst of {score.seeds} seeds (means in score.md)" if score.seeds > 1 else "one seed"
    console.table(f"score [s, N], {seeds}", *overview(summaries, means=False), left=left)
    if request.ablate:
        console.table("without each law: mean change and largest [s, N]", *ablation_table(score, places=False))
    for entry, own in verdicts if not request.ablate else verdicts[:1]:
        if own:
            console.table(f"what is asked: {entry.label}", *verdict_table(own))
    for entry in score.entries:
        console.say(f"worst case of {worst_line(score, entry)}")
        for line in breaking(summaries, entry):
            console.say(f"  breaks in {line}")


def _page(request: Request, score: Score, verdicts: Sequence[tuple[Entry, Sequence[Verdict]]]) -> str:
    """The tables for a browser, with the command that plays the worst run of each case and leaves its own page."""
    from polish_sim.analysis.run_record import once_more
    from polish_sim.experiments.registry import default_scenario
    from polish_sim.page.page import page_html, tables_page
    from polish_sim.scoring import breaking, overview, summarize, verdict_table, worst_case, worst_line

    summaries = summarize(score.cases, score.entries, score.rows)
    tables: dict[str, list[Sequence[str]]] = {
        f"Asked of {entry.label}": _rows(*verdict_table(own)) for entry, own in verdicts if own
    }
    tables["Cases, mean / worst of the seeds"] = _rows(*overview(summaries))
    runs: list[Sequence[str]] = [["case", "controller", "seed", "the worst run, with a page of its own"]]
    for summary in summaries:
        worst = worst_case([summary], summary.entry)
        if worst is not None:
            scenario = summary.case.scenario(summary.entry, worst["seed"])
            command = once_more(scenario, default_scenario(scenario.experiment))
            runs.append([summary.case.name, summary.entry.label, str(worst["seed"]), command])
    tables["Look at one"] = runs
    named = ", ".join(entry.label for entry in score.entries)
    about = f"{count_text(len(score.rows), 'run')} of {count_text(len(score.cases), 'case')}"
    notes = [f"worst case of {worst_line(score, entry)}" for entry in score.entries]
    notes += [f"{entry.label} breaks in {line}" for entry in score.entries for line in breaking(summaries, entry)]
    return page_html(tables_page(f"score: {named}", about, tables, notes))


def _rows(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    return [headings, *rows]


def _ablation_page(request: Request, score: Score) -> str:
    from polish_sim.scoring import ablation_table

    headings, rows = ablation_table(score)
    lines = [headings, ["---"] * len(headings), *rows]
    grid = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return f"\n## What each law of `{request.entries[0].label}` is worth\n\n{grid}\n"


@contextmanager
def open_folder(
    out: Path | None, asked: Mapping[str, Any], overwrite: bool = False, kind: str = "score"
) -> Iterator[Path]:
    """Make the folder of a score, or take up one that the same score has begun, and keep others out while it is filled.

    ``asked``: what the score is of, by name: only the same one is continued, unless ``overwrite``. Raises InputError if
    the folder holds something else, is in use, or not writable.
    """
    folder = rows_folder(out, kind, "score")
    with locked(folder, kind):
        if not overwrite:
            _refuse_another(folder, asked)
        put(folder, ASKED, json.dumps(asked, indent=1) + "\n")
        yield folder


def put(folder: Path, name: str, content: str | bytes) -> None:
    """Write a file of the score; it appears when it is whole."""
    with whole_file(folder / name) as draft:
        draft.write_bytes(content.encode() if isinstance(content, str) else content)


def _refuse_another(folder: Path, asked: Mapping[str, Any]) -> None:
    """Refuse a folder in which another score was begun."""
    begun = _begun(folder)
    if begun is None or begun == asked:
        return
    raise InputError(
        f"'{folder}' holds another {asked['of']}: {_difference(begun, asked)}. Choose another folder with --out"
        + (", or add --overwrite to replace it; runs that both have are kept." if asked["of"] == "score" else ".")
    )


def _begun(folder: Path) -> Mapping[str, Any] | None:
    """What the score in a folder is of; None if there is none yet, nothing known if it cannot be read."""
    if not (folder / ROWS).stat().st_size and not (folder / ASKED).exists():
        return None
    try:
        begun = json.loads((folder / ASKED).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return begun if isinstance(begun, dict) else {}


def _difference(begun: Mapping[str, Any], asked: Mapping[str, Any]) -> str:
    """The first thing in which two scores differ, in words."""
    if begun.get("of") != asked["of"]:
        return f"a {begun['of']}, not a {asked['of']}" if "of" in begun else "what it is of is not known"
    for name in (name for name in asked if name not in ("of", "rows")):
        if begun.get(name) != asked.get(name):
            return f"its {name} are {_listed(begun.get(name))}, not {_listed(asked.get(name))}"
    return "a controller's file or settings, or this program, have changed since it was begun"


def _listed(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
