"""Shows and writes a payload that was identified; imported only inside the command."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Final

import numpy as np

from polish_sim.analysis.run_record import METRICS, package_versions, write_json
from polish_sim.cli import console
from polish_sim.cli.outcome import Outcome
from polish_sim.identification.arm import LoggedRobot
from polish_sim.identification.estimate import INTERVAL_95
from polish_sim.identification.log_file import RobotLog, periodic_states, read_robot_log, spline_states
from polish_sim.identification.payload import BODY_NAMES, BODY_UNITS, Weighed, body_of, weigh_from_logs
from polish_sim.identification.regressor import States
from polish_sim.identification.settings import IDENTIFY

FILE: Final = "payload.csv"
COLUMNS: Final = ("name", "value", "unit", "std", "low_95", "high_95", "nearest_body", "true_value")


def read_run(file: Path, robot: LoggedRobot, period: float | None) -> tuple[RobotLog, States]:
    """A robot's log and its states."""
    chain = robot.model.chain
    log = read_robot_log(file, chain.geometry.kind.tolist(), period, () if robot.file is None else chain.joints)
    return log, spline_states(log) if period is None else periodic_states(log, period)


def weigh_alone(robot: LoggedRobot, file: Path, period: float | None, draft: Path) -> Outcome:
    """Find a payload from one log, the robot's model believed as it is, and write the folder."""
    with console.progress() as observer:
        observer.stage("read the log")
        run = read_run(file, robot, period)
        observer.stage("fit the payload")
        weighed = weigh_from_logs(robot, None, run)
    write_payload(draft, weighed)
    write_json(draft / METRICS, {**weighed.figures, "versions": package_versions()})
    show_payload(weighed)
    note = (
        "the arm was believed to be as its model says: intervals count noise only. --data adds a run without payload."
    )
    return Outcome(IDENTIFY["payload-data"], f"payload from {file.name}", {"payload": weighed.figures}, notes=(note,))


def write_payload(folder: Path, weighed: Weighed) -> None:
    """Write ``payload.csv``: mass, centre and inertia about it in the last link's frame, with intervals."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    payload = weighed.payload
    values, std = payload.body()
    nearest = body_of(payload.nearest_body(), payload.origin)
    for k, (name, unit) in enumerate(zip(BODY_NAMES, BODY_UNITS, strict=True)):
        half = INTERVAL_95 * std[k]
        numbers = [f"{x:.9g}" for x in (values[k] - half, values[k] + half, nearest[k])]
        true = "" if weighed.truth is None else f"{body_of(weighed.truth, payload.origin)[k]:.9g}"
        table.writerow([name, f"{values[k]:.9g}", unit, f"{std[k]:.4g}", *numbers, true])
    (folder / FILE).write_text(out.getvalue(), encoding="utf-8")


def show_payload(weighed: Weighed) -> None:
    """Print the payload."""
    values, std = weighed.payload.body()
    true = np.full(10, np.nan) if weighed.truth is None else body_of(weighed.truth, weighed.payload.origin)
    rows = [
        [name, unit, f"{value:.5g}", f"{deviation:.2g}", "-" if np.isnan(truth) else f"{truth:.5g}"]
        for name, unit, value, deviation, truth in zip(BODY_NAMES, BODY_UNITS, values, std, true, strict=True)
    ]
    console.table("payload, in the last link's frame", ["number", "unit", "value", "std", "true"], rows)
