"""`polish-sim calibrate tcp` and `calibrate base`: where the tool is on its flange, where the second robot stands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from polish_sim.cli import console
from polish_sim.cli import option_types as o
from polish_sim.cli.output_folder import claimed
from polish_sim.errors import InputError

PANEL = "Instrument and measurements"
LARGEST_NOISE_MM, MOST_POINTS = 10.0, 100_000


def option(name: str, metavar: str, text: str) -> Any:
    """An option of the instrument's panel."""
    return typer.Option(name, metavar=metavar, help=text, rich_help_panel=PANEL)


Data = Annotated[
    Path | None,
    option("--data", "FILE.csv", "Measurements of real robots instead of simulated ones: docs/calibration.md."),
]
TouchNoise = Annotated[
    float | None, option("--noise", "MM", "Noise of a touch per coordinate, rms (mm); default 0.05.")
]
TrackerNoise = Annotated[
    float | None, option("--noise", "MM", "Noise of a measured point per coordinate, rms (mm); default 0.03.")
]
CellTool = Annotated[
    bool,
    typer.Option(
        "--cell-tool",
        help="Simulate the cell's own tool, which `run dual --calibration` takes, not one planted by the seed.",
        rich_help_panel=PANEL,
    ),
]
Poses = Annotated[int | None, option("--poses", "N", "Touches, 4 or more; default 10.")]
Cone = Annotated[float | None, option("--cone", "DEG", "Tilt of the tool in the touches, 3 to 90 (deg); default 45.")]
Points = Annotated[
    int | None,
    option("--points", "N", "Points of an arc (default 200), poses of each robot (12) or common points (10)."),
]
Method = Annotated[str, option("--method", "NAME", "circles, poses or handshake: docs/calibration.md.")]
Pair = Annotated[
    str, option("--pair", "NAME", "Name of the two robots; a run refuses the calibration of another pair.")
]


def tcp(
    data: Data = None,
    noise: TouchNoise = None,
    poses: Poses = None,
    cone: Cone = None,
    cell_tool: CellTool = False,
    seed: o.Seed = None,
    seeds: o.Seeds = None,
    check: o.Check = False,
    out: o.Out = None,
    overwrite: o.Overwrite = False,
) -> int:
    """Find the tool's tip from touches of one fixed point, and its axes from moves along them."""
    given = {"--noise": noise, "--poses": poses, "--cone": cone, "--cell-tool": cell_tool or None}
    given |= {"--seed": seed, "--seeds": seeds}
    refuse_idle(data, given)
    within("--noise", noise, 0.0, LARGEST_NOISE_MM, "mm")
    within("--poses", poses, 4, MOST_POINTS, "")
    within("--cone", cone, 3.0, 90.0, "deg")
    # Lazy: --help must not wait for the libraries.
    from polish_sim.cli import frame_calibration as work
    from polish_sim.dual.calibrate_tcp import TcpTrial

    trial = TcpTrial(**_chosen(noise=(noise, 1e-3), poses=(poses, 1), cone=(cone, math.pi / 180.0), seed=(seed, 1)))
    if cell_tool:
        trial = work.of_the_cell(trial)
    with claimed(out, "calibrate-tcp", overwrite) as folder:
        if data is not None:
            outcome = work.tcp_from_data(data, folder.draft)
        elif seeds is None:
            outcome = work.tcp_once(trial, folder.draft)
        else:
            outcome = work.tcp_many(trial, range(trial.seed, trial.seed + seeds), folder.draft)
    outcome.show()
    console.say(f"folder: {folder.final}")
    return outcome.exit_code(check)


def base(
    data: Data = None,
    method: Method = "circles",
    noise: TrackerNoise = None,
    points: Points = None,
    pair: Pair = "simulated",
    seed: o.Seed = None,
    seeds: o.Seeds = None,
    check: o.Check = False,
    out: o.Out = None,
    overwrite: o.Overwrite = False,
) -> int:
    """Find where the second robot's base stands in the first one's, from a laser tracker or from common touches."""
    given = {"--noise": noise, "--points": points, "--seed": seed, "--seeds": seeds}
    refuse_idle(data, given)
    within("--noise", noise, 0.0, LARGEST_NOISE_MM, "mm")
    within("--points", points, 3, MOST_POINTS, "")
    # Lazy: --help must not wait for the libraries.
    from polish_sim.cli import frame_calibration as work
    from polish_sim.dual.calibrate_bases import BaseTrial

    work.check_method(method)
    trial = BaseTrial(method, **_chosen(noise=(noise, 1e-3), points=(points, 1), seed=(seed, 1)))
    with claimed(out, "calibrate-base", overwrite) as folder:
        if data is not None:
            outcome = work.base_from_data(data, method, pair, folder.draft)
        elif seeds is None:
            outcome = work.base_once(trial, pair, folder.draft)
        else:
            outcome = work.base_many(trial, range(trial.seed, trial.seed + seeds), folder.draft)
    outcome.show()
    console.say(f"folder: {folder.final}")
    return outcome.exit_code(check)


def refuse_idle(data: Path | None, given: Mapping[str, Any]) -> None:
    """Refuse options of a simulated measurement beside a real one.

    Raises:
        InputError: Naming them.
    """
    idle = [name for name, value in given.items() if value is not None]
    if data is not None and idle:
        raise InputError(f"{', '.join(idle)} would change nothing with --data: leave it out.")


def within(name: str, value: float | None, low: float, high: float, unit: str) -> None:
    """Refuse a value of an option outside its range.

    Raises:
        InputError: It is outside.
    """
    if value is not None and not low <= value <= high:
        raise InputError(f"{name} {value:g} is outside {low:g} to {high:g} {unit}".rstrip() + ".")


def _chosen(**values: tuple[Any, float]) -> dict[str, Any]:
    """Options that were given, in SI."""
    return {name: value * scale for name, (value, scale) in values.items() if value is not None}
