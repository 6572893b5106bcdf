"""The `polish-sim` command: one Typer app whose commands, a file each, load when they are asked for.

Heavy libraries are imported inside the commands that need them, so that `--help` answers at once.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from polish_sim import __version__
from polish_sim.cli import console
from polish_sim.cli.boundary import execute
from polish_sim.cli.catalogue import as_command
from polish_sim.experiments.registry import load

COMMANDS = {
    "demo": "The whole main job on a shipped part.",
    "plan": "A tool path on a part.",
    "inspect": "The quality of any tool path on a part.",
    "job": "Setups, regions and passes from one file.",
    "job init": "That file for a part, to begin with.",
    "smooth": "Jerk-limited motion along any tool path.",
    "score": "Score a controller by a fixed battery of cases.",
    "serve": "A simulated UR controller for your own programme.",
    "sweep": "Many runs over settings and seeds, in one table.",
    "tune": "Search a controller's parameters.",
    "identify": "A robot's dynamics from its own motion.",
    "compare": "A robot's log beside the simulation.",
    "report": "Plots and tables again from saved runs.",
    "view": "A saved run in the browser, in 3D and over time.",
    "config": "The full default config as TOML.",
    "list": "What ships with the package.",
    "run": "Simulate arc, force, surface, smooth, teach or dual.",
    "calibrate": "Calibrate the cell: payload, tcp, base, arm, budget.",
}
"""What each command is for; it has its name in the file of that name."""
ELSEWHERE = {
    "demo": "run:demo",
    "run": "run:runs",
    "config": "catalogue:config",
    "list": "catalogue:list_names",
    "job init": "job:init_job",
}


class CommandGroup(TyperGroup):
    """The commands by name; a file is imported when its command is asked for."""

    def __init__(self, **named: Any) -> None:
        super().__init__(**named)
        self.commands = dict.fromkeys(COMMANDS)  # type: ignore[assignment]

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that words name, which may be two, and the words behind it."""
        two = " ".join(args[:2])
        return super().resolve_command(ctx, [two, *args[2:]] if two in COMMANDS else args)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command by its name; None for an unknown one."""
        if cmd_name not in COMMANDS:
            return None
        place = ELSEWHERE.get(cmd_name, f"{cmd_name}:{cmd_name}")
        return as_command(cmd_name, load(f"polish_sim.cli.{place}"), COMMANDS[cmd_name])


commands = typer.Typer(
    name="polish-sim",
    cls=CommandGroup,
    help="Force-controlled robotic polishing in MuJoCo: from a part's mesh to a scored run. "
    "Lengths are in mm, angles in deg, forces in N, speeds in mm/s.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        console.say(f"polish-sim {__version__}")
        raise typer.Exit


@commands.callback()
def _every_command(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True)
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an unexpected error.")
    ] = False,
) -> None:
    """Take the options that stand before the command; the boundary reads --debug itself."""


def _interrupt(number: int, _frame: FrameType | None) -> None:
    """End as by Ctrl-C, which keeps what was recorded, unless that is ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)
    signal.raise_signal(signal.SIGINT)


def app() -> None:
    """Run the command line of this process and end it with the exit code of the contract.

    ``kill``, ``timeout``, a batch system and a closed terminal end it as Ctrl-C does.
    """
    console.outlive_terminal()
    for number in {signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)}:
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup ignores SIGHUP
            signal.signal(number, _interrupt)
    code = execute(commands, sys.argv[1:])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is written and said
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # its reader has gone
            stream.flush()
    os._exit(code)  # taking the simulator and the compiler down in order would last half a second
