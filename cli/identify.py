"""`polish-sim identify`: a robot's dynamics from its own motion, simulated or from a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from polish_sim.cli import console
from polish_sim.cli import option_types as o
from polish_sim.cli.output_folder import claimed
from polish_sim.cli.rendering import prepare_headless
from polish_sim.errors import InputError

IDENTIFICATION = "Identification"
Method = Annotated[
    str | None,
    typer.Option(
        "--method",
        metavar="NAME",
        help="joint (default), stepwise (poses at rest first) or stepwise-axes (axes 1 to 3 first).",
        rich_help_panel=IDENTIFICATION,
    ),
]
Objective = Annotated[
    str | None,
    typer.Option(
        "--objective",
        metavar="NAME",
        help="What the exciting motion makes small: i-optimal (default), d-optimal or condition.",
        rich_help_panel=IDENTIFICATION,
    ),
]
Periods = Annotated[
    int | None,
    typer.Option("--periods", metavar="N", help="Periods of 10 s to log; default 5.", rich_help_panel=IDENTIFICATION),
]
Starts = Annotated[
    int | None,
    typer.Option(
        "--starts",
        metavar="N",
        help="Random motions the search begins from; default 1.",
        min=1,
        rich_help_panel=IDENTIFICATION,
    ),
]
Data = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="FILE.csv",
        help="A robot's own log instead of a simulated one; columns: docs/identification.md.",
        rich_help_panel=IDENTIFICATION,
    ),
]
Period = Annotated[
    float | None,
    typer.Option(
        "--period",
        metavar="S",
        help="The motion of --data repeats after this time (s).",
        rich_help_panel=IDENTIFICATION,
    ),
]
Model = Annotated[
    Path | None,
    typer.Option(
        "--model",
        metavar="FILE.xml",
        help="MJCF of the robot of --data; without it the cell's UR5e.",
        rich_help_panel=IDENTIFICATION,
    ),
]
Joints = Annotated[
    str | None,
    typer.Option(
        "--joints",
        metavar="NAMES",
        help="Joints of --model that make the chain, with commas; default: all.",
        rich_help_panel=IDENTIFICATION,
    ),
]
Payload = Annotated[
    float | None,
    typer.Option(
        "--payload",
        metavar="KG",
        help="Then carry a block of this mass and find its mass, centre and inertia (kg).",
        rich_help_panel=IDENTIFICATION,
    ),
]
PayloadData = Annotated[
    Path | None,
    typer.Option(
        "--payload-data",
        metavar="FILE.csv",
        help="Log of the robot carrying a payload; without --data the robot's model is believed as it is.",
        rich_help_panel=IDENTIFICATION,
    ),
]
Task = Annotated[
    Path | None,
    typer.Option(
        "--task",
        metavar="PLAN",
        help="What the model is for: a plan or path, a run's folder, or joint positions over time (csv, npz).",
        rich_help_panel=IDENTIFICATION,
    ),
]
Report = Annotated[
    bool,
    typer.Option(
        "--report", help="Only say which numbers torques can tell at all.", rich_help_panel=IDENTIFICATION
    ),
]  # fmt: skip


def identify(
    method: Method = None,
    objective: Objective = None,
    periods: Periods = None,
    starts: Starts = None,
    data: Data = None,
    period: Period = None,
    model: Model = None,
    joints: Joints = None,
    task: Task = None,
    payload: Payload = None,
    payload_data: PayloadData = None,
    report: Report = False,
    seed: o.Seed = None,
    check: o.Check = False,
    out: o.Out = None,
    overwrite: o.Overwrite = False,
) -> int:
    """Identify inertia and friction of the arm from its own motion, with intervals, and write them as a model."""
    given = {
        "method": method,
        "objective": objective,
        "periods": periods,
        "starts": starts,
        "seed": seed,
        "payload": payload,
    }
    given = {name: value for name, value in given.items() if value is not None}
    measured = data if data is not None else payload_data
    asked = given if task is None else {**given, "task": task}
    if report:
        files = {"data": data, "payload-data": payload_data, "period": period, "out": out}
        _refuse_beside_report({**asked, **files, "overwrite": overwrite or None, "check": check or None})
    _refuse_idle(asked, data=measured, period=period, model=model, joints=joints, report=report)
    if method is not None and data is None and payload_data is not None:
        raise InputError("--method would change nothing with --payload-data alone: leave it out, or add --data.")
    prepare_headless()
    # Lazy: the simulator takes a second to load, --help must not wait for it.
    from polish_sim.cli.identification import Logs, from_log, identifiable_numbers, robot_for, simulated
    from polish_sim.cli.weighing import weigh_alone
    from polish_sim.identification.settings import IdentifySettings

    settings = IdentifySettings(**given)  # type: ignore[arg-type]
    if report:
        identifiable_numbers(robot_for(model, joints))
        return 0
    with claimed(out, "identify", overwrite) as folder:
        if data is not None:
            logs = Logs(data, payload_data, period)
            outcome = from_log(robot_for(model, joints), logs, settings.method, folder.draft)
        elif payload_data is not None:
            outcome = weigh_alone(robot_for(model, joints), payload_data, period, folder.draft)
        else:
            outcome = simulated(settings, folder.draft, task)
    outcome.show()
    console.say(f"folder: {folder.final}")
    return outcome.exit_code(check)


def _refuse_beside_report(given: dict[str, Any]) -> None:
    """Refuse what a report of the model alone does not look at."""
    idle = [f"--{name}" for name, value in given.items() if value is not None]
    if idle:
        raise InputError(f"{', '.join(idle)} would change nothing with --report: leave it out.")


def _refuse_idle(
    given: dict[str, Any], *, data: Path | None, period: float | None, model: Path | None, joints: str | None,
    report: bool,
) -> None:  # fmt: skip
    """Refuse options that would change nothing, and a period that is none."""
    idle = [f"--{name}" for name in given if name != "method"]
    if data is not None and idle:
        raise InputError(f"{', '.join(idle)} would change nothing with --data: leave it out.")
    if data is None and period is not None:
        raise InputError("--period belongs to --data: a simulated motion repeats after 10 s.")
    if period is not None and period <= 0.0:
        raise InputError(f"--period {period:g}: the time after which a motion repeats is more than 0 s.")
    if period is not None and given.get("method", "joint") != "joint":
        raise InputError(f"--method {given['method']} takes a log with a part before the motion: leave --period out.")
    if model is not None and data is None and not report:
        raise InputError("--model belongs to --data or --report: what is simulated is the cell's UR5e.")
    if joints is not None and model is None:
        raise InputError("--joints belongs to --model: the cell's UR5e has its six.")
