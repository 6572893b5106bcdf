"""The `polish-sim` command: one Typer app, its commands gathered from one file each.

Heavy libraries are imported inside the commands that need them, so that `--help` answers at once.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import Annotated

import typer

from polish_sim import __version__
from polish_sim.cli import console
from polish_sim.cli.boundary import execute
from polish_sim.cli.calibrate import calibrate
from polish_sim.cli.catalogue import PanelledCommand, config, list_names
from polish_sim.cli.compare import compare
from polish_sim.cli.identify import identify
from polish_sim.cli.inspect import inspect
from polish_sim.cli.job import job
from polish_sim.cli.plan import plan
from polish_sim.cli.report import report
from polish_sim.cli.run import RunGroup, demo
from polish_sim.cli.score import score
from polish_sim.cli.serve import serve
from polish_sim.cli.smooth import smooth
from polish_sim.cli.sweep import sweep
from polish_sim.cli.tune import tune
from polish_sim.cli.view import view

commands = typer.Typer(
    name="polish-sim",
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


runs = typer.Typer(cls=RunGroup, rich_markup_mode=None)


@runs.callback()
def _every_run() -> None:
    """Simulate an experiment of the papers; 'polish-sim run EXPERIMENT --help' shows its options."""


for _name, _command, _text in (
    ("demo", demo, "The whole main job on a shipped part."),
    ("plan", plan, "A tool path on a part."),
    ("inspect", inspect, "The quality of any tool path on a part."),
    ("job", job, "Setups, regions and passes from one file."),
    ("smooth", smooth, "Jerk-limited motion along any tool path."),
    ("score", score, "Score a controller by a fixed battery of cases."),
    ("serve", serve, "A simulated UR controller for your own programme."),
    ("sweep", sweep, "Many runs over settings and seeds, in one table."),
    ("tune", tune, "Search a controller's parameters."),
    ("identify", identify, "A robot's dynamics from its own motion."),
    ("compare", compare, "A robot's log beside the simulation."),
    ("report", report, "Plots and tables again from saved runs."),
    ("view", view, "A saved run in the browser, in 3D and over time."),
    ("config", config, "The full default config as TOML."),
    ("list", list_names, "What ships with the package."),
):
    commands.command(_name, cls=PanelledCommand, short_help=_text)(_command)
commands.add_typer(runs, name="run", short_help="Simulate arc, force, surface, smooth, teach or dual.")
commands.add_typer(
    calibrate, name="calibrate", short_help="Calibrate the cell: payload, tcp, base, arm, budget."
)


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
