"""`polish-sim identify`: a robot's dynamics from its own motion, simulated or from a log."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from polish_sim.analysis.claim import Claim
from polish_sim.cli import console
from polish_sim.cli.boundary import Outcome
from polish_sim.cli.compare import LOG_OPTIONS, override_robot, read_measured_log
from polish_sim.cli.many import Means, carry_out
from polish_sim.cli.options import OUTPUT_OPTIONS, Given, Own, chosen, refuse_beside, refuse_without, takes
from polish_sim.cli.output_folder import claimed
from polish_sim.config import Scenario
from polish_sim.errors import InputError, count_text
from polish_sim.experiments.registry import SEED_OPTIONS
from polish_sim.page import Table, number_or_dash

if TYPE_CHECKING:
    from polish_sim.cell import Observer
    from polish_sim.identification import IdentifySettings
    from polish_sim.identification.arm import LoggedRobot
    from polish_sim.identification.identify import Identification
    from polish_sim.identification.log_file import RobotLog
    from polish_sim.identification.payload import Weighed
    from polish_sim.identification.regressor import States

PANEL = "Identification"
FOUND = ("unit", "value", "std", "true")  #: Headings of the table of identified parameters
FULL_PERIODS = 5
#: A joint is noted if the model explains less than this share of its torque's variance
LITTLE_EXPLAINED = 0.5
OF_SIMULATED = ("--periods", "--starts", "--payload", "--task", "--set", *SEED_OPTIONS)


@takes(
    Own("--periods", PANEL, "N", "Periods of 10 s to log; default 5. 360 take half an hour and 6 GB.",
        int, 1, 360),
    Own("--starts", PANEL, "N", "Random motions the search begins from; default 1.", int, 1, 1e4),
    Own("--data", PANEL, "FILE", "A robot's own log instead of a simulated one; columns: "
        "docs/identification.md.", Path),
    Own("--period", PANEL, "S", "The motion of --data repeats after this time (s).", float, 1e-3),
    Own("--model", PANEL, "FILE.xml", "MJCF of the robot of --data; without it the cell's arm.", Path),
    Own("--arm", PANEL, "NAME", "The robot of --data: a bare arm of this make, ur5e or ur10e, its gears' "
                                "friction fitted along; any log that compare reads, of torques or currents."),
    Own("--joints", PANEL, "NAMES", "Joints of --model that make the chain, with commas; default: all."),
    Own("--task", PANEL, "PLAN", "What the model is for: a plan or path, a run's folder, or joint positions "
                                 "over time (csv, npz).", Path),
    Own("--payload", PANEL, "KG", "Then carry a block of this mass, up to 3 kg beside the tool, and find its "
                                  "mass, centre and inertia (kg).",
        float, 0.0, 3.0),
    Own("--payload-data", PANEL, "FILE", "Log of the robot of --data carrying a payload.", Path),
    Own("--report", PANEL, "", "Only list the parameters that torques can identify."),
    *LOG_OPTIONS,
    *(*SEED_OPTIONS, "--set", "--check", *OUTPUT_OPTIONS),
)  # fmt: skip
def identify(given: Given) -> int:
    """Identify inertia and friction of the arm from its own motion, with intervals, and write them as a
    model."""
    _refuse_idle(given)
    from polish_sim.identification import IdentifySettings

    if given["--report"]:
        show_identifiable(_robot(given))
        return 0
    takes = "'identify': it takes robot.arm and robot.real.KEY"
    scenario = override_robot(Scenario(), given["--set"] or [], ("robot.arm=", "robot.real."), takes)
    settings = IdentifySettings(**chosen(given, "periods", "starts", "seed", "payload"), robot=scenario.robot)
    if given["--data"] is None:
        return simulated(settings, given)
    with claimed(given, "identify") as folder:
        outcome = from_logs(given, folder.draft)
    return outcome.finish(folder.final, given["--check"])


def _refuse_idle(given: Given) -> None:
    """Refuse options that would change nothing."""
    files = ("--data", "--payload-data", "--period", "--out", "--overwrite", "--check")
    refuse_beside(given, "--report", *OF_SIMULATED, *files)
    refuse_beside(given, "--data", *OF_SIMULATED)
    if given["--payload-data"] is not None and given["--data"] is None:
        raise InputError("--payload-data needs --data, the same robot's log without the payload: add it.")
    refuse_without(given, "--data", "--period", *(option.name for option in LOG_OPTIONS))
    refuse_without(given, "--data --report", "--model", "--arm")
    refuse_without(given, "--model", "--joints")
    refuse_beside(given, "--model", "--arm")


def _robot(given: Given) -> LoggedRobot:
    """The robot of ``--model`` and ``--joints``, or the cell's arm."""
    from polish_sim.identification.arm import arm_of_table, cell_arm, robot_of_file

    if given["--arm"] is not None:
        return arm_of_table(given["--arm"])
    if given["--model"] is None:
        return cell_arm()
    joints = given["--joints"]
    return robot_of_file(
        given["--model"], None if joints is None else [name.strip() for name in joints.split(",")]
    )


def simulated(settings: IdentifySettings, given: Given) -> int:
    """Identify simulated arms, for a task if one is given: one, or as many as there are ``--seeds``."""
    from polish_sim.identification.folder import write_folder
    from polish_sim.identification.identify import run_identification
    from polish_sim.identification.log_file import use_states

    use = None if given["--task"] is None else use_states(given["--task"])

    def run(seed: int, observer: Observer) -> Identification:
        return run_identification(replace(settings, seed=seed), observer, use)

    def write(found: Identification, folder: Path) -> None:
        write_folder(folder, found)

    depends = f"{replace(settings, seed=0)} {[bytes(states) for states in use or ()]}"
    what, claims = f"identification, {count_text(settings.periods, 'period')}", asked_of(settings, bool(use))
    means = Means("identify", what, run, show_identification, write, claims, mean="mean", usual="local")
    return carry_out(given, means, depends)


def asked_of(settings: IdentifySettings, for_task: bool = False) -> tuple[Claim, ...]:
    """What is asked of a simulated identification, for a task or for any motion."""
    from polish_sim.identification import ELASTIC, GEARS, IDENTIFY

    claims = IDENTIFY["task" if for_task else ("full" if settings.periods >= FULL_PERIODS else "short")]
    if not settings.robot.elastic:
        return claims
    # Its torques are predicted from what both encoders read: their steps and the gears' ripple are in every
    # error.
    return tuple(c._replace(high=ELASTIC) if c.figure == "nrms_heldout_mean" else c for c in claims) + GEARS


def from_logs(given: Given, draft: Path) -> Outcome:
    """Identify a robot, and what it carries in a second log, from its own logs; write the folder."""
    from polish_sim.identification import IDENTIFY
    from polish_sim.identification.folder import write_folder
    from polish_sim.identification.identify import identify_from_log
    from polish_sim.identification.payload import weigh_from_logs

    robot, file, loaded = _robot(given), given["--data"], given["--payload-data"]
    with console.progress() as observer:
        observer.stage("read the log")
        run = _read(given, file, robot)
        observer.stage("fit the model")
        found = identify_from_log(robot, *run)
        if loaded is not None:
            observer.stage("fit the payload")
            weighed = weigh_from_logs(robot, run, _read(given, loaded, robot))
            found = replace(found, weighed=weighed, figures=found.figures | weighed.figures)
        observer.stage("draw")
        write_folder(draft, found, robot.source)
    show_identification(found)
    claims = IDENTIFY["data" if robot.model.load is None else "gears"]
    return Outcome(
        claims, f"identification from {file.name}", {"this robot": found.figures}, notes=doubts(found)
    )


def doubts(found: Identification) -> tuple[str, ...]:
    """Signs that a user's log is wrong though it could be fitted."""
    shares = zip(found.model.chain.joints, found.figures["r_squared"], strict=True)
    low = [f"{joint} ({100 * max(share, 0.0):.0f}%)" for joint, share in shares if share < LITTLE_EXPLAINED]
    if not low:
        return ()
    return (
        f"the model explains little of the torque of {', '.join(low)}. Are the columns in the joints' order, "
        "signs and units right, and the torques those of the same samples?",
    )


def show_identifiable(robot: LoggedRobot) -> None:
    """Print which parameters torques identify alone, which only in combination, which not at all."""
    from polish_sim.identification.estimate import base_names, base_of, identifiable

    model = robot.model
    base = base_of(model)
    rows = zip(model.names, model.units, identifiable(base), strict=True)
    console.table(Table("which parameters torques identify", ["parameter", "unit", "identified"], list(rows)))
    combinations = [[f"{k}", name] for k, name in enumerate(base_names(base, model.names), 1)]
    console.table(Table(f"the {base.rank} base parameters", ["number", "combination"], combinations, left=2))


def show_identification(found: Identification) -> tuple[str, ...]:
    """Print friction, rotors and offsets, how well the rest is known, and the payload."""
    from polish_sim.identification.folder import rows_of
    from polish_sim.identification.regressor import WAVES

    rows = rows_of(found)
    alone = [
        _row_of(r.name, r.unit, r.value, r.std, r.true_value)
        for r in rows
        if r.identifiable in ("alone", "gear") and r.name[:3] not in WAVES
    ]
    console.table(Table("parameters identified alone", ["parameter", *FOUND], alone))
    console.say(f"all {len(rows)} numbers, base parameters with 95% intervals: parameters.csv")
    if found.weighed is not None:
        show_payload(found.weighed)
    return ()


def _read(given: Given, file: Path, robot: LoggedRobot) -> tuple[RobotLog, States]:
    """Samples and states of a robot's log."""
    from polish_sim.arms import arm_table
    from polish_sim.exchange.robot_log import CUT
    from polish_sim.identification import log_file

    period, arm, chain = given["--period"], given["--arm"], robot.model.chain
    of_gap = None if period else f"{CUT} If the whole motion repeats, give --period S."
    kinds = chain.geometry.kind.tolist() if arm is None else ()
    if given["--model"]:
        log_file.check_joints(file, given["--run"] or "", kinds, chain.joints)
    recording = read_measured_log(file, given, ("q_rad",), kinds, of_gap)
    log = log_file.log_of(file, recording, period, () if arm is None else arm_table(arm).torque_constants)
    return log, log_file.spline_states(log) if period is None else log_file.periodic_states(log, period)


def show_payload(weighed: Weighed) -> None:
    """Print the payload."""
    from polish_sim.identification.payload import BODY_NAMES, BODY_UNITS

    columns = BODY_NAMES, BODY_UNITS, *weighed.payload.body(), weighed.true_body()
    rows = [_row_of(*row) for row in zip(*columns, strict=True)]
    console.table(Table("payload, in the last link's frame", ["number", *FOUND], rows))


def _row_of(name: str, unit: str, value: float, std: float, truth: float | None) -> list[str]:
    return [name, unit, f"{value:.5g}", f"{std:.2g}", number_or_dash(truth, ".5g")]
