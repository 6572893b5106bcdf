"""What the program says of itself: `polish-sim list`, `config` and the help of commands, options grouped.

Plain text, because rich would make every --help wait.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from polish_sim.cli import console
from polish_sim.cli.options import argument
from polish_sim.errors import check_name
from polish_sim.experiments.registry import ROWS, default_scenario, experiments, known_faults
from polish_sim.experiments.rows import PAYLOAD_SCENARIO
from polish_sim.scenario_file import to_toml
from polish_sim.toml_text import END, WHOLE

REST = "Options"


class PanelledCommand(TyperCommand):
    """A command whose help lists its options under the panels they were declared with, and calls arguments by
    name."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Write what stands behind the command: options, then each argument."""
        return ["[OPTIONS]", *(_shown(p) for p in self.get_params(ctx) if p.param_type_name == "argument")]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, then each panel in the order of its first option."""
        panels: dict[str, list[Any]] = {"Arguments": []}
        for parameter in self.get_params(ctx):
            panel = getattr(parameter, "rich_help_panel", None) or REST
            record = parameter.get_help_record(ctx)
            if parameter.param_type_name == "argument":
                panel, record = "Arguments", (_shown(parameter), getattr(parameter, "help", ""))
            panels.setdefault(panel, []).append(record)
        for title, records in panels.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def as_command(name: str, work: Any, text: str, cls: type[PanelledCommand] = PanelledCommand) -> Any:
    """A function, or a Typer with several, as a command, with a short ``text`` for the list of all."""
    app = work
    if not isinstance(work, typer.Typer):
        app = typer.Typer(add_completion=False, rich_markup_mode=None)
        app.command(name, cls=cls)(work)
    command = typer.main.get_command(app)
    command.short_help = text
    return command


def _shown(argument: Any) -> str:
    """An argument as a user writes it: PART, RUN..., [KIND]."""
    name = argument.metavar + ("" if argument.nargs == 1 else "...")
    return name if argument.required else f"[{name}]"


# What ships with the package, and the default config of an experiment.


KINDS = ("parts", "controllers", "experiments", "patterns", "faults", "tools")
LIMITS = "limits"  #: Not an experiment, but a file of defaults as well

Kind = Annotated[
    str | None,
    argument("KIND", f"{', '.join(KINDS)}: one a line, with what it is."),
]
Name = Annotated[
    str,
    argument("EXPERIMENT", "arc, force, surface, smooth, teach, dual, calibrate-payload, or limits."),
]


def config(experiment: Name) -> None:
    """Print the full default config of an experiment as TOML; `plan` and `inspect` take the keys of surface.

    `limits` prints the default limits of tool and joints, for the command `smooth`.
    """
    payload = PAYLOAD_SCENARIO.experiment
    known = (*ROWS, payload, LIMITS)
    check_name("experiment", experiment, known)
    if experiment == LIMITS:
        from polish_sim.motion.rules.limits import SmoothingLimits, limits_toml

        text = limits_toml(SmoothingLimits())
    else:
        text = to_toml(PAYLOAD_SCENARIO if experiment == payload else default_scenario(experiment))
    console.say(text.removeprefix(WHOLE).removesuffix(END).rstrip())


def list_names(kind: Kind = None) -> None:
    """List the parts, controllers, experiments, patterns, faults and tools that ship with the package."""
    known = _known()
    if kind is None:
        for each, entries in known.items():
            console.say(f"{each}: {', '.join(entries)}")
        return
    check_name("kind of thing to list", kind, known)
    width = max(len(name) for name in known[kind])
    for name, text in known[kind].items():
        console.say(f"{name:<{width}}  {text}".rstrip())


def _known() -> Mapping[str, Mapping[str, str]]:
    """Names of every kind, each with a line that says what it is."""
    from polish_sim.control import CONTROLLERS
    from polish_sim.job.tools import read_tools
    from polish_sim.models import WORKPIECES
    from polish_sim.planning import PATTERNS

    return {
        "parts": WORKPIECES,
        "controllers": {
            **_first_lines(CONTROLLERS),
            "FILE.py:CLASS": "your own, see docs/controllers.md",
            "FILE.npz:linear": "a policy, see docs/learning.md",
        },
        "experiments": {name: row.text for name, row in experiments().items()},
        "patterns": _first_lines({name: pattern.plan for name, pattern in PATTERNS.items()}),
        "faults": {name: fault.text for name, fault in known_faults().items()},
        "tools": {name: tool.text for name, tool in read_tools().items()},
    }


def _first_lines(functions: Mapping[str, object]) -> dict[str, str]:
    """The first line of each function's docstring, as a phrase."""
    lines = {
        name: (function.__doc__ or "").strip().partition("\n")[0] for name, function in functions.items()
    }
    return {name: line[:1].lower() + line[1:].rstrip(".") for name, line in lines.items()}
