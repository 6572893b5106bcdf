"""`polish-sim list`: what ships with the package."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import typer

from polish_sim.cli import console
from polish_sim.errors import unknown_name

KINDS = ("parts", "controllers", "experiments", "patterns", "faults")

Kind = Annotated[
    str | None,
    typer.Argument(metavar="[KIND]", help=f"{', '.join(KINDS)}: one a line, with what it is.", show_default=False),
]


def list_names(kind: Kind = None) -> None:
    """List the parts, controllers, experiments, patterns and faults that ship with the package."""
    if kind is not None and kind not in KINDS:
        raise unknown_name("kind of thing to list", kind, KINDS)
    known = _known()
    if kind is None:
        for each, entries in known.items():
            console.say(f"{each + ':':<13} {', '.join(entries)}")
        return
    width = max(len(name) for name in known[kind])
    for name, text in known[kind].items():
        console.say(f"{name:<{width}}  {text}".rstrip())


def _known() -> Mapping[str, Mapping[str, str]]:
    """Names of every kind, each with a line that says what it is, or with none."""
    # Lazy: --help must not wait for the numerical libraries.
    from polish_sim.cell import FAULTS
    from polish_sim.control import CONTROLLERS
    from polish_sim.experiments import EXPERIMENTS
    from polish_sim.models import workpiece_names
    from polish_sim.planning import PATTERNS

    return {
        "parts": dict.fromkeys(workpiece_names(), ""),
        "controllers": {**dict.fromkeys(CONTROLLERS, ""), "FILE.py:CLASS": "your own, see docs/controllers.md"},
        "experiments": dict(EXPERIMENTS),
        "patterns": dict.fromkeys(PATTERNS, ""),
        "faults": {name: fault.text for name, fault in FAULTS.items()},
    }
