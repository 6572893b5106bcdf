"""`polish-sim tune`: search a controller's parameters, judge them on seeds and cases the search never saw."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE
from polish_sim.cli.many import filled
from polish_sim.cli.options import OWN, Given, Own, argument, takes
from polish_sim.config.key import RUN
from polish_sim.errors import InputError, check_name, first_twice, needed, number_text
from polish_sim.experiments.registry import default_scenario
from polish_sim.page import Table, save_page
from polish_sim.row_file import Rows, put_file, write_metrics
from polish_sim.scenario_file import override
from polish_sim.toml_text import toml_text

if TYPE_CHECKING:
    from polish_sim.studies.tune import Search, Verdict
    from polish_sim.workers import Runner

TUNED = "tuned.toml"
TRIALS, SEEDS, HELD_OUT_SEEDS = 100, 2, 5
ControllerName = Annotated[
    str,
    argument("CONTROLLER", "A shipped controller or FILE.py:CLASS."),
]


@takes(
    Own(
        "--over",
        RUN,
        "NAMES",
        "Parameters to search, with commas: names or beginnings of keys under "
        "controller, or of an own class, each with =low:high if its range is not "
        "to be a quarter to four times the shipped value.",
    ),
    Own(
        "--goal",
        RUN,
        "HOW:FIGURE",
        "What is made small: worst or mean of a score's figure; default worst:rms_error_n.",
    ),
    Own(
        "--subject-to",
        RUN,
        "CONDITIONS",
        "What every run must keep, with commas: stable, or FIGURE<=VALUE; default stable.",
    ),
    Own("--trials", RUN, "N", f"Trials in all; default {TRIALS}.", int, 1, 1e5),
    Own("--sampler", RUN, "NAME", "tpe (default) or cmaes."),
    Own(
        "--case",
        RUN,
        "NAME",
        "Cases of the score the search sees, names or patterns, may be repeated; the "
        "others are held out. Default: seven of them.",
        list,
    ),
    Own("--seeds", RUN, "N", f"Seeds per case in the search; default {SEEDS}.", int, 1, 1e3),
    Own(
        "--held-out-seeds",
        RUN,
        "N",
        f"Seeds per case of the final table; default {HELD_OUT_SEEDS}.",
        int,
        1,
        1e3,
    ),
    OWN["--set"]._replace(
        text="KEY=VALUE of the config that all runs keep, shipped and tuned; may be repeated."
    ),
    *("--workers", "--on", "--out"),
)
def tune(controller: ControllerName, given: Given) -> int:
    """Search the parameters that make a figure of the score small, and write them as tuned.toml.

    Shipped and found values are compared in the end on seeds and cases the search did not see.
    """
    for module in ("optuna", "cmaes"):
        needed(module, "'tune' searches with Optuna", "tune")
    from polish_sim.experiments.assembly import user_files
    from polish_sim.scoring import check_entries
    from polish_sim.studies.tune import judge_tuned, search_best

    search = asked_search(controller, given)
    lowest = search.entry({p.key: p.low for p in search.over})
    check_entries((*search.cases, *search.held_out), [lowest, search.entry(None)])
    trials = given["--trials"] or TRIALS

    def found(runner: Runner) -> tuple[dict[str, float], list[Verdict]]:
        def tried(number: int, text: str) -> None:
            console.note(f"trial {number} of {trials}: {text}")
            runner.heard(number, trials, None)

        best = search_best(search, trials, runner, tried)
        console.note("shipped and tuned, on held-out seeds and cases")
        return best, judge_tuned(search, best, given["--held-out-seeds"] or HELD_OUT_SEEDS, runner)

    stage = f"search {', '.join(p.key for p in search.over)}, {trials} trials"
    files = user_files(search.cases[0].scenario(search.entry(None), 0))
    with filled(given, "tune", _facts(search), stage, lambda at: (Rows(at), found), files) as (
        folder,
        (best, verdicts),
    ):
        put_file(folder, TUNED, tuned_toml(search, best))
        show_search(search, best, verdicts, folder)
    return DONE


def asked_search(controller: str, given: Given) -> Search:
    """What a command line asks to search, checked.

    Raises:
        PolishSimError: Naming what is wrong with it.
    """
    from polish_sim.scoring import user_entry
    from polish_sim.studies.tune import SAMPLERS, Search, read_condition, read_goal, read_over, training_cases

    if not given["--over"]:
        raise InputError("what shall be tuned? Name it, e.g. --over force_p,force_i.")
    name = user_entry(controller).name
    sampler = given["--sampler"] or "tpe"
    check_name("sampler", sampler, SAMPLERS)
    over = read_over(name, [word.strip() for word in given["--over"].split(",")])
    if twice := first_twice([searched.key for searched in over]):
        raise InputError(f"--over names {twice} twice.")
    conditions = tuple(
        read_condition(word.strip()) for word in (given["--subject-to"] or "stable").split(",")
    )
    seen, held_out = training_cases(given["--case"] or [])
    return Search(
        name, over, read_goal(given["--goal"] or "worst:rms_error_n"), conditions, seen, held_out,
        given["--seeds"] or SEEDS, tuple(given["--set"] or ()), sampler,
    )  # fmt: skip


def _facts(search: Search) -> dict[str, Any]:
    """What a search is of, to compare it with another."""
    return {
        "of": "tune",
        "controllers": [search.controller],
        "over": [list(searched[:3]) for searched in search.over],
        "goal": ":".join(search.goal),
        "subject_to": [condition.label for condition in search.conditions],
        "cases": [case.name for case in search.cases],
        "seeds": search.seeds,
        "settings": list(search.settings),
        "sampler": search.sampler,
    }


def tuned_toml(search: Search, best: Mapping[str, float]) -> str:
    """The values found as a file for ``run --config``."""

    entry = search.entry(best)
    chosen = override(
        default_scenario("force"), [f"controller.name={json.dumps(entry.name)}", *entry.settings]
    )
    table: dict[str, Any] = {"controller": {"name": entry.name}}
    for word in entry.settings:
        *parents, last = word.partition("=")[0].split(".")
        value, leaf = chosen, table
        for name in parents:
            value, leaf = getattr(value, name), leaf.setdefault(name, {})
        leaf[last] = value[last] if isinstance(value, Mapping) else getattr(value, last)
    return toml_text(table, {}, ["polish-sim run force --config tuned.toml, or run surface"])


def show_search(search: Search, best: Mapping[str, float], verdicts: Sequence[Verdict], folder: Path) -> None:
    """Write metrics.json and the page, print the tables."""
    from polish_sim.page.page import Page

    asked = _facts(search)
    goal, conditions = asked["goal"], ", ".join(asked["subject_to"])
    values = [[p.key, number_text(p.shipped, 4), number_text(best[p.key], 4),
                f"{number_text(p.low, 4)} to {number_text(p.high, 4)}"] for p in search.over]  # fmt: skip
    headings = [
        "where",
        "rows",
        f"shipped {goal}",
        "tuned",
        f"shipped not {conditions}",
        "tuned not",
        "better",
    ]
    rows = [[v.what, str(v.rows), number_text(v.shipped, 4), number_text(v.tuned, 4), str(v.shipped_broken),
              str(v.tuned_broken), "yes" if v.better else "NO"] for v in verdicts]  # fmt: skip
    facts = asked | {
        "best": dict(best),
        "judged": [v._asdict() | {"better": v.better} for v in verdicts],
    }
    write_metrics(folder, facts)
    tables = (
        Table(f"tune {search.controller}", ["parameter", "shipped", "tuned", "searched"], values),
        Table("shipped and tuned; goals of the runs in which both keep the conditions", headings, rows),
    )
    save_page(folder, Page.of(f"tune: {search.controller}", f"{goal}, subject to {conditions}", tables))
    for table in tables:
        console.table(table)
    if worse := [v.what for v in verdicts[1:] if not v.better]:
        where = " and on ".join(worse)
        console.say(f"on {where} the tuned values are NOT better than the shipped ones: keep those.")
    console.say(f"to run: polish-sim run force --config {shlex.quote(str(folder / TUNED))}")
    console.say_folder(folder)
