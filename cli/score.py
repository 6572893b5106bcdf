"""`polish-sim score`: the fixed battery for one controller, or for two side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE
from polish_sim.cli.rendering import prepare_headless
from polish_sim.errors import InputError

SEEDS, SEEDS_OF_REACH = 5, 20

Controller = Annotated[
    str, typer.Option("--controller", metavar="NAME", help="A shipped controller (see 'list') or FILE.py:CLASS.")
]
Against = Annotated[
    str | None, typer.Option("--against", metavar="NAME", help="A second controller, to put beside it.")
]
Seeds = Annotated[
    int | None,
    typer.Option("--seeds", metavar="N", min=1, help="Seeds per case, counting up from 0; default 5, with --reach 20."),
]
Cases = Annotated[
    list[str] | None,
    typer.Option("--case", metavar="NAME", help="Only this case, or pattern such as 'latency-*'; may be repeated."),
]
Reach = Annotated[bool, typer.Option("--reach", help="The cases behind the figures asked, instead of the battery.")]
Ablate = Annotated[bool, typer.Option("--ablate", help="Leave out one law of the controller after the other.")]
Border = Annotated[
    bool, typer.Option("--border", help="Search springs and latencies up to which it stays stable, instead of scoring.")
]
List = Annotated[bool, typer.Option("--list", help="List the cases and what is run in each.")]
Check = Annotated[bool, typer.Option("--check", help="Exit with 1 when a figure falls short of what is asked of it.")]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="KEY=VALUE of the config for --controller; may be repeated."),
]
Workers = Annotated[
    int | None, typer.Option("--workers", metavar="N", min=1, help="Processes to share the runs out to; default: all.")
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="DIR", help="Folder; the same score begun there is continued. Default results/score/..."
    ),
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace another score in --out; runs that both have are kept.")
]


def score(
    controller: Controller = "hybrid-pi",
    against: Against = None,
    seeds: Seeds = None,
    case: Cases = None,
    reach: Reach = False,
    ablate: Ablate = False,
    border: Border = False,
    list_: List = False,
    check: Check = False,
    set_: Set = None,
    workers: Workers = None,
    out: Out = None,
    overwrite: Overwrite = False,
) -> int:
    """Score a controller by a fixed battery of cases under honest disturbances; Ctrl-C keeps what is done."""
    if ablate and against is not None:
        raise InputError("--ablate compares a controller with itself: leave --against out.")
    prepare_headless()
    # Lazy: --help must not wait for the numerical libraries.
    from polish_sim.cli.score_folder import open_folder
    from polish_sim.cli.scoring import Wish, score_and_tell
    from polish_sim.scoring import BATTERY, REACH_CASES, ablations, asked_for, check_entries, choose_cases, user_entry

    cases = choose_cases(REACH_CASES if reach else BATTERY, case or [])
    if list_:
        console.table("cases of the score", ["case", "what is run"], [[c.name, c.text] for c in cases], left=2)
        return DONE
    own = user_entry(controller, set_ or [], "with --set" if set_ else "")
    entries = [own, *ablations(own)] if ablate else [own, *([user_entry(against)] if against is not None else [])]
    check_entries(cases, entries)
    if border:
        from polish_sim.cli.border import border_and_tell

        if set_ or ablate:
            raise InputError("--border knows controllers as they ship: leave --set and --ablate out.")
        with open_folder(out, {"of": "border", "controllers": [entry.label for entry in entries]}, overwrite) as folder:
            return border_and_tell(entries, folder)
    wish = Wish(cases, tuple(entries), seeds or (SEEDS_OF_REACH if reach else SEEDS), reach, ablate, workers)
    with open_folder(out, asked_for(cases, entries, wish.seeds), overwrite) as folder:
        return score_and_tell(wish, folder, check)
