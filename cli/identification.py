"""Runs an identification for its command and writes its folder; imported only inside the command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.analysis.run_record import METRICS, package_versions, write_json
from polish_sim.cli import console
from polish_sim.cli.outcome import Outcome
from polish_sim.cli.weighing import read_run, show_payload, write_payload
from polish_sim.experiments.report import save_plots
from polish_sim.identification.arm import LoggedRobot, cell_arm, robot_of_file
from polish_sim.identification.estimate import base_names, base_of, identifiable
from polish_sim.identification.identify import Identification, identify_from_log, run_identification
from polish_sim.identification.model_file import IdentifiedJoints, write_identified
from polish_sim.identification.payload import weigh_from_logs
from polish_sim.identification.physical import parameter_rows, parameters_csv
from polish_sim.identification.plot import MotionData, TorqueData, plot_motion, plot_torques
from polish_sim.identification.settings import IDENTIFY, IdentifySettings
from polish_sim.identification.use_motion import use_states

SIMULATED, SHORT, STEPWISE, FOR_TASK = "full", "short", "stepwise", "task"
MEASURED, MEASURED_STEPWISE = "data", "data-stepwise"
OTHER = "-other"
"""After the name of a simulated one whose motion has another objective than the default."""
FULL_PERIODS = 5
HALF_TOLD = 0.5
"""A joint is noted if the model explains less than this share of its torque's variance."""


class Logs(NamedTuple):
    """A user's logs."""

    empty: Path
    loaded: Path | None = None
    """The same robot carrying a payload."""
    period: float | None = None
    """After which the motion of both repeats [s]; None if it does not."""


def simulated(settings: IdentifySettings, draft: Path, task: Path | None = None) -> Outcome:
    """Identify the simulated arm, for a task if one is given, and write its folder."""
    use = None if task is None else use_states(task)
    with console.progress() as observer:
        found = run_identification(settings, observer, use)
        observer.stage("draw")
        _write(draft, found)
    _show_parameters(found)
    if found.weighed is not None:
        write_payload(draft, found.weighed)
        show_payload(found.weighed)
    title = f"identification, {settings.method}, {settings.objective}, {settings.periods} periods, seed {settings.seed}"
    kind = FOR_TASK if task is not None else asked_of(settings)
    return Outcome(IDENTIFY[kind], title, {"this arm": found.figures})


def asked_of(settings: IdentifySettings) -> str:
    """The name in ``IDENTIFY`` of what is asked of a simulated identification without a task."""
    experiment = SIMULATED if settings.periods >= FULL_PERIODS else SHORT
    experiment = experiment if settings.method == IdentifySettings.method else STEPWISE
    return experiment if settings.objective == IdentifySettings.objective else experiment + OTHER


def from_log(robot: LoggedRobot, logs: Logs, method: str, draft: Path) -> Outcome:
    """Identify a robot, and what it carries in a second log, from its own logs, and write its folder."""
    file = logs.empty
    with console.progress() as observer:
        observer.stage("read the log")
        run = read_run(file, robot, logs.period)
        observer.stage("fit the model")
        found = identify_from_log(robot, *run, method)
        if logs.loaded is not None:
            weighed = weigh_from_logs(robot, run, read_run(logs.loaded, robot, logs.period))
            found = replace(found, weighed=weighed, figures=found.figures | weighed.figures)
            write_payload(draft, weighed)
        observer.stage("draw")
        _write(draft, found, robot.file)
    _show_parameters(found)
    if found.weighed is not None:
        show_payload(found.weighed)
    experiment = MEASURED if method == "joint" else MEASURED_STEPWISE
    title = f"identification from {file.name}, {method}"
    return Outcome(IDENTIFY[experiment], title, {"this robot": found.figures}, notes=doubts(found))


def doubts(found: Identification) -> tuple[str, ...]:
    """What makes a user's log look wrong though it could be fitted."""
    shares = zip(found.model.chain.joints, found.figures["r_squared"], strict=True)
    low = [f"{joint} ({100 * max(share, 0.0):.0f}%)" for joint, share in shares if share < HALF_TOLD]
    if not low:
        return ()
    return (
        f"the model explains little of the torque of {', '.join(low)}. Are the columns in the joints' order, "
        "signs and units right, and the torques those of the same samples?",
    )


def robot_for(model: Path | None, joints: str | None) -> LoggedRobot:
    """The robot of ``--model`` and ``--joints``, or the cell's arm."""
    if model is None:
        return cell_arm()
    names = None if joints is None else [name.strip() for name in joints.split(",")]
    return robot_of_file(model, names)


def identifiable_numbers(robot: LoggedRobot) -> None:
    """Print which parameters torques tell alone, which only in combination, which not at all."""
    model = robot.model
    base = base_of(model)
    told = identifiable(base)
    rows = [[name, unit, said] for name, unit, said in zip(model.names, model.units, told, strict=True)]
    console.table("what torques tell of each parameter", ["parameter", "unit", "told"], rows)
    combinations = [[str(k + 1), name] for k, name in enumerate(base_names(base, model.names))]
    console.table(f"the {base.rank} base parameters", ["number", "combination"], combinations, left=2)


def _write(folder: Path, found: Identification, source: Path | None = None) -> None:
    truth = None if found.truth is None else found.model.truth()
    rows = parameter_rows(found.model, found.base, found.found, found.full, truth)
    (folder / "parameters.csv").write_text(parameters_csv(rows), encoding="utf-8")
    write_identified(folder, found.model.chain.joints, _joints(found), source)
    write_json(folder / METRICS, {**found.figures, "versions": package_versions()})
    plots = {"torques.png": plot_torques(_torques(found), "Torques of a motion that was not fitted", _facts(found))}
    if found.motion is not None:
        t = np.linspace(0.0, found.motion.period, 1001)
        states = found.motion(t)
        facts = [
            f"predicts other motions to {found.figures['predicted_error_sigma']:.4f} of the noise after one period",
            f"condition {found.figures['condition_motion']:.0f}",
        ]
        plots["motion.png"] = plot_motion(MotionData(t, states.q, states.qd), "The exciting motion", facts)
    save_plots(folder, plots)


def _joints(found: Identification) -> IdentifiedJoints:
    n = found.model.joints
    friction = dict(zip(found.model.terms, found.full[10 * n :].reshape(-1, n), strict=True))
    own = found.full[: 10 * n].reshape(n, 10) - found.drawing.carried
    return IdentifiedJoints(own, friction.get("viscous"), friction.get("coulomb"), friction.get("armature"))


def _torques(found: Identification) -> TorqueData:
    held = found.held_out
    Y = found.model.regressor(held.states)
    predicted = Y[:, :, found.base.columns] @ found.found.theta
    error = np.array(found.figures["nrms_heldout"])
    return TorqueData(held.time, held.measured, predicted, Y @ found.drawing.parameters, error)


def _facts(found: Identification) -> list[str]:
    figures = found.figures
    return [
        f"error {100 * figures['nrms_heldout_mean']:.3f}% of the range (mean of the joints)",
        f"drawing {100 * figures['nrms_heldout_drawing_mean']:.1f}%",
        f"{figures['base_parameters']} parameters from {figures['samples']} samples",
    ]


def _show_parameters(found: Identification) -> None:
    """Print friction, rotors and offsets, and how well the rest is known."""
    truth = None if found.truth is None else found.model.truth()
    rows = parameter_rows(found.model, found.base, found.found, found.full, truth)
    alone = [row for row in rows if row.identifiable == "alone"]
    table = [
        [
            row.name,
            row.unit,
            f"{row.value:.5g}",
            f"{row.std:.2g}",
            "-" if np.isnan(row.true_value) else f"{row.true_value:.5g}",
        ]
        for row in alone
    ]
    console.table("parameters told alone", ["parameter", "unit", "value", "std", "true"], table)
    console.say(f"all {len(rows)} numbers, base parameters with 95% intervals: parameters.csv")
