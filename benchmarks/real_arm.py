"""A real UR10e beside the simulated one: joints without contact, force control in contact.

    python -m benchmarks.real_arm joints --data FOLDER            # *.npz: logs of the joints
    python -m benchmarks.real_arm identify --data FOLDER          # its dynamics, and what it carried
    python -m benchmarks.real_arm forces --data FOLDER            # force_mode_*.npz: curves of the force
    python -m benchmarks.real_arm forces --data FOLDER --picture FILE.png
    python -m benchmarks.real_arm laws --data FOLDER              # our laws on the same steps
    python -m benchmarks.real_arm fit --data FOLDER               # the rig, on one curve
    python -m benchmarks.real_arm flange --data FOLDER            # a measured active flange beside ours
    python -m benchmarks.real_arm flange-fit --data FOLDER        # its rig, on one curve

Joints: Mamedov and Mikhel, Frontiers in Robotics and AI 7, 571574 (2020). Forces: Gadringer, Gattringer and
Mueller, Mechanical Sciences 13, 361-370 (2022). The data are not ours to ship; docs/how_real.md says how they
were read.

What is fitted, and on what: friction and gears of ``robot.arm = ur10e`` on the logs of `FITTED`; the rig of
the straight profile on `ONE_CURVE`, that of the ramp's sheet on `ONE_RAMP`, the virtual mass of force-mode on
the times of the approaches. All else is computed with these; the choice of mass and contact stiffness had
seen the straight cases.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from benchmarks import real_flange
from benchmarks.table import Row, print_rows
from polish_sim.arms import arm_table
from polish_sim.compare.figures import (
    ForceStep,
    compare_steps,
    from_contact,
    measure_step,
)
from polish_sim.compare.replay import (
    SCENARIO,
    CarriedPayload,
    commands_of,
    compare_joints,
    plot_steps,
    rigid_torques,
    warm,
)
from polish_sim.config import RobotConfig, Scenario
from polish_sim.errors import PolishSimError
from polish_sim.exchange.robot_log import read_robot_recording
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.identification.arm import arm_of_table
from polish_sim.identification.estimate import informative, torque_error
from polish_sim.identification.identify import fit_samples
from polish_sim.identification.log_file import RobotLog, log_of, spline_states
from polish_sim.identification.payload import weigh_from_logs
from polish_sim.identification.regressor import FULL, States
from polish_sim.scenario_file import override

UR10E: Final = "robot.arm=ur10e"
FITTED: Final = ("ident_50s_12harm", "ident_20_01_31_unload")
#: Not used for the gears' error; friction was fitted on all unloaded logs, these among them.
HELD_OUT: Final = ("ident_30s_12harm", "ident_50s_14harm", "validation_ptp_10_points")
MOVES_S: Final = (6.4, 35.0)  #: In which the first of the logs held out moves [s]
LOADED: Final = ("ident_50s_14harm_load", CarriedPayload(2.805, (0.0, 0.0, 0.05)))
"""The log with a load, its mass as published; where its centre is was not: 50 mm before the flange."""


class ContactRig(NamedTuple):
    """What a robot presses with, felt at the tool: its arm's mass behind a soft servo, on a stiff part."""

    stiffness: float  #: Of the arm as its force mode lets it yield [N/m]
    damping: float  #: [N s/m]
    mass: float  #: That lands on the part [kg]
    contact: float  #: Stiffness of roller and part [N/m]


RIG_SETTINGS: Final = (
    *("part.file=plate", "part.displacement_m=0", "part.rotation_rad=0", "part.form_error_m=0"),
    *(
        "safety.force_limit_n=1e4",
        "safety.jump_limit_n=0",
        "safety.offset_limit_m=0.2",
        "safety.contact_lost_s=1e5",
    ),
    *(
        "sensor.force_range_n=1e5",
        "sensor.torque_range_nm=1e4",
        "safety.torque_limit_nm=1e3",
        "head.travel_m=0.1",
    ),
    *("pad.damping_s_m=0.3", "robot.linear_acceleration_m_s2=20", "simulation.log_rate_hz=1000"),
)
"""Of `run force`: stiff landings at the speed of a force mode, no guard in the way."""


def on_rig(scenario: Scenario, rig: ContactRig, asked: float, approach: float, *settings: str) -> Scenario:
    """A scenario of `force` on a rig: ``asked`` [N] after an approach [m/s]."""
    own = [f"process.contact_force_n={asked}", f"process.approach_speed_m_s={approach}"]
    spring = [f"head.stiffness_n_m={rig.stiffness}", f"head.damping_n_s_m={rig.damping}"]
    pad = [f"pad.stiffness_n_m={rig.contact}"]
    scenario = override(scenario, [*RIG_SETTINGS, *own, *spring, *pad, *settings])
    # The head stands for the arm's own mass here, more than a head may have.
    return replace(scenario, head=replace(scenario.head, mass_kg=rig.mass))


def joint_rows(data: Path) -> Iterator[Row]:
    """Measured beside simulated, by joint, and the largest deviations on logs kept from the gears' fit."""
    robot = override(SCENARIO, [UR10E]).robot
    for names, what in ((FITTED, "fitted on"), (HELD_OUT, "held out")):
        found = {name: compare_joints(robot, _log(data, name), CarriedPayload()).figures for name in names}
        for name, figures in found.items():
            yield Row(f"{name} ({what}): torque NRMS [%]", _six(100.0 * np.array(figures["nrms"])), "-")
        for key, unit in (("ripple_cycles", "1/turn"), ("ripple_nm", "N m")):
            both = [
                np.nanmedian([f[prefix + key] for f in found.values()], axis=0)
                for prefix in ("simulated_", "")
            ]
            yield Row(f"{what}: {key} [{unit}], median of the logs", _six(both[0]), _six(both[1]))
        for name, figures in found.items():
            off = 100.0 * np.array(figures["friction_curve_error"])
            yield Row(f"{name}: friction by speed, largest error [%]", _six(off), "within 20")
        delays = ", ".join(f"{1e3 * f['motion_delay_s']:.1f}" for f in found.values())
        yield Row(f"{what}: motion, measured behind simulated [ms]", delays, "-")
    yield _own_torques(robot, data, HELD_OUT[0])
    for payload, named in ((LOADED[1], "2.805 kg"), (CarriedPayload(), "none")):
        figures = compare_joints(robot, _log(data, LOADED[0]), payload).figures
        yield Row(
            f"{LOADED[0]}, payload {named}: torque NRMS [%]", _six(100.0 * np.array(figures["nrms"])), "-"
        )


IDENTIFIED: Final = (*FITTED, "ident_30s_12harm")  #: Logs a model is fitted to; checked on others held out


def identified_rows(data: Path) -> Iterator[Row]:
    """Torques of logs that were not fitted, by rigid links with friction by speed and by gears' friction; and
    the payload."""
    robot = arm_of_table("ur10e")
    logs = [_arm_log(data, name) for name in IDENTIFIED]
    torque = np.concatenate([log.torque for log in logs])
    parts = zip(*(spline_states(log) for log in logs), strict=True)
    states = States(*(np.concatenate(part) for part in parts))
    geared, rigid = (
        fit_samples(model, states, torque)
        for model in (robot.model, replace(robot.model, terms=FULL, load=None))
    )
    for name in (name for name in HELD_OUT if name not in IDENTIFIED):
        log = _arm_log(data, name)
        held = spline_states(log)
        measured = np.where(informative(held), log.torque, np.nan)
        both = [100.0 * torque_error(fit.torque(held), measured) for fit in (geared, rigid)]
        for j, (ours, plain) in enumerate(zip(*both, strict=True), 1):
            yield Row(f"{name}, joint {j}: torque NRMS [%]", f"{ours:.3g}", f"{plain:.3g}")
    whole = RobotLog(np.arange(len(torque)), states.q, torque), states
    log = _arm_log(data, LOADED[0])
    loaded = log, spline_states(log)
    masses = (
        weigh_from_logs(replace(robot, model=fit.model), whole, loaded).figures for fit in (geared, rigid)
    )
    given = (f"{found['payload_mass_kg']:.3f} +- {found['payload_mass_std_kg']:.3f}" for found in masses)
    yield Row(f"payload of {LOADED[1].mass} kg: mass found [kg]", *given)


def _arm_log(data: Path, name: str) -> RobotLog:
    return log_of(data / name, _log(data, name), constants=arm_table("ur10e").torque_constants)


def _own_torques(robot: RobotConfig, data: Path, name: str) -> Row:
    """What the robot's controller computes for its links and rotors, beside our table, while it moves."""
    log = _log(data, name)
    commands, theirs = commands_of(log), log.values["torque_desired_nm"]
    states = (commands(log.time, order) for order in range(3))
    off = theirs - rigid_torques(warm(robot), *states, CarriedPayload())
    moving = (log.time > MOVES_S[0]) & (log.time < MOVES_S[1])
    rms = np.sqrt(np.mean(np.array([off, theirs])[:, moving] ** 2, axis=1))
    return Row(
        f"{name}: controller's torques less the table's, rms [N m]", _six(rms[0]), f"of {_six(rms[1])}"
    )


def _log(data: Path, name: str) -> Any:
    return read_robot_recording(data / f"{name}.npz", ("q_rad",))


def _six(values: Sequence[float]) -> str:
    return " ".join("-" if math.isnan(value) else f"{value:.3g}" for value in values)


# In contact.


class Case(NamedTuple):
    """One of the published steps of UR's force mode."""

    profile: str  #: straight, ramp or contact
    force: float  #: [N]
    gain: float
    #: That its name says: of the path on the straight profile, of approach and path on the others [m/s]
    speed: float

    @property
    def name(self) -> str:
        """As the data name it."""
        return f"ur_{self.force:.0f}N_gain{self.gain:g}_v{self.speed:.2f}"

    @property
    def approach(self) -> float:
        """Speed at which it lands: pushed from rest over `RUN_UP`, no faster than its limit [m/s]."""
        limit = TOP_SPEED if self.profile == "straight" else self.speed
        return min(limit, math.sqrt(2.0 * RUN_UP[self.profile] * self.force * self.gain / MODE_MASS))


MODE_MASS: Final = 48.5  #: Of force-mode at a scaling of 1; see `masses` [kg]
TOP_SPEED: Final = 0.25  #: Limit along the axis on the straight profile, as published [m/s]
RUN_UP: Final = {"straight": 0.081, "ramp": 0.134, "contact": 0.303}
"""Way to the part, from the times from the recordings' beginning to contact [m]."""
BEFORE_S: Final = 0.25  #: From a recording's beginning to the force mode's, from the same times [s]
STRAIGHT: Final = tuple(
    Case("straight", F, gain, v) for F in (15.0, 35.0, 55.0) for gain in (0.5, 1.0) for v in (0.1,)
)
RAMP: Final = (
    *(Case("ramp", 15.0, 0.5, 0.1), Case("ramp", 35.0, 0.5, 0.1), Case("ramp", 35.0, 1.0, 0.1)),
    *(Case("ramp", 55.0, 1.0, 0.1), Case("ramp", 15.0, 0.5, 0.25), Case("ramp", 15.0, 1.0, 0.25)),
    *(Case("ramp", 35.0, 1.0, 0.25), Case("ramp", 55.0, 0.5, 0.25)),
)
CONTACT: Final = (
    *(Case("contact", 100.0, 0.5, 0.1), Case("contact", 100.0, 0.5, 0.25), Case("contact", 100.0, 1.0, 0.25)),
)
#: About half the impulse of the first 35 ms by the speed of landing, 26 to 50 kg [kg]
IMPACT_MASS: Final = 20.0
DAMPINGS: Final = (150.0, 300.0, 450.0, 600.0, 800.0, 1000.0)
ONE_CURVE: Final = STRAIGHT[2]
ONE_RAMP: Final = RAMP[1]
RIGS: Final = {
    "straight": ContactRig(7700.0, 800.0, IMPACT_MASS, 1e6),
    "ramp": ContactRig(8400.0, 300.0, IMPACT_MASS, 2e5),
    "contact": ContactRig(7700.0, 800.0, IMPACT_MASS, 1e6),
}
"""Found by ``fit``; the contact test's is the straight profile's."""


def measured_step(data: Path, case: Case) -> ForceStep:
    """The published curve."""
    log = read_robot_recording(data / f"force_mode_{case.profile}.npz", ("force_n",), run=case.name)
    return from_contact(log.time, log.values["force_n"][:, 0], case.force)


def simulated_step(case: Case, rig: ContactRig, law: str = "force-mode", *settings: str) -> ForceStep:
    """The same step in the cell; a run that stops itself ends there."""
    mode = [f"controller.baselines.mode_gain_scaling={case.gain}", "controller.baselines.mode_damping=0"]
    own = [UR10E, f"controller.name={law}", f"controller.force_limit_m_s={TOP_SPEED}", *mode, *settings]
    run = run_experiment(on_rig(default_scenario("force"), rig, case.force, case.approach, *own))
    time, force = (run.log[name] for name in ("time_s", "normal_force_n"))
    return from_contact(time, force, case.force)


def force_rows(data: Path, pairs: list[tuple[str, ForceStep, ForceStep]]) -> Iterator[Row]:
    """Each step's settling time and mean error, measured and simulated; fills ``pairs``."""
    for case in (*STRAIGHT, *RAMP, *CONTACT):
        measured, simulated = measured_step(data, case), simulated_step(case, RIGS[case.profile])
        found = compare_steps(measured, simulated)
        name = f"{case.profile} {case.force:.0f} N, gain {case.gain:g}, {case.speed:g} m/s"
        pairs.append((name, measured, simulated))
        for key, unit in (("settling_s", "s"), ("mean_error_n", "N"), ("peak_n", "N"), ("lost_s", "s")):
            ours, theirs = found[f"simulated_{key}"], found[key]
            yield Row(f"{name}: {key} [{unit}]", f"{ours:.3g} ({_percent(ours, theirs)})", f"{theirs:.3g}")
        yield Row("  rms of the curves' difference [N]", f"{found['force_rms_n']:.3g}", "-")


def _percent(ours: float, theirs: float) -> str:
    if math.isnan(ours) or math.isnan(theirs):
        return "both not settled" if math.isnan(ours) and math.isnan(theirs) else "one not settled"
    return f"{100.0 * (ours / theirs - 1.0):+.0f}%" if theirs else "-"


LAWS: Final = ("hybrid-pi", "hybrid-adaptive")


def law_rows(data: Path) -> Iterator[Row]:
    """Our laws on the straight profile's rig, landing at 20 mm/s, beside force mode and flange."""
    for force in (15.0, 35.0, 55.0):
        for law in LAWS:
            case = Case("straight", force, 1.0, 0.1)
            settings = ["process.approach_speed_m_s=0.02", "controller.force_limit_m_s=0.05"]
            try:
                step = simulated_step(case, RIGS["straight"], law, *settings)
                yield from _step_rows(f"{law}, {force:.0f} N, simulated", step)
            except PolishSimError as error:
                yield Row(f"{law}, {force:.0f} N", str(error)[:80], "-")
        for gain in (0.5, 1.0):
            case = Case("straight", force, gain, 0.1)
            yield from _step_rows(
                f"UR force mode, {force:.0f} N, gain {gain:g}, measured", measured_step(data, case)
            )
        log = read_robot_recording(data / "force_mode_straight.npz", run=f"acf_{force:.0f}N_ramp0.0_v0.10")
        flange = from_contact(log.time, log.values["force_n"][:, 0], force)
        yield from _step_rows(f"active flange, {force:.0f} N, measured", flange)


def _step_rows(name: str, step: ForceStep) -> Iterator[Row]:
    found = measure_step(step)
    shown = [f"{found[key]:.3g}" for key in ("settling_s", "mean_error_n", "peak_n", "lost_s")]
    yield Row(name, " / ".join(shown), "-")


def mass_rows(data: Path) -> Iterator[Row]:
    """Virtual mass of the real force mode: by how much sooner a larger push brings the tool to its speed
    limit.

    Pushed by F g on a mass M from rest, a tool that reaches its limit v on the way d needs d / v + v M / (2 F
    g).
    """
    for profile, v, cases in (
        ("ramp", 0.1, [(55.0, 1.0), (35.0, 1.0), (35.0, 0.5), (15.0, 0.5)]),
        ("contact", 0.25, [(100.0, 1.0), (100.0, 0.5)]),
    ):
        before = [_before_contact(data, Case(profile, F, gain, v)) for F, gain in cases]
        push = np.array([F * gain for F, gain in cases])
        slope = np.polyfit(1.0 / push, before, 1)[0]
        yield Row(f"{profile}, limit {v:g} m/s: M at a scaling of 1 [kg]", f"{2.0 * slope / v:.1f}", "-")


def _before_contact(data: Path, case: Case) -> float:
    with np.load(data / f"force_mode_{case.profile}.npz") as file:
        return -float(file[f"{case.name}/time_s"][0])


def fit_rows(data: Path) -> Iterator[Row]:
    """The rigs on one curve each: stiffness from its period, damping by the least difference of the
    low-passed curves.

    Mass and contact are those of the first impact: its impulse by the speed, and its width.
    """
    for case, contact in ((ONE_CURVE, 1e6), (ONE_RAMP, 2e5)):
        measured, best = measured_step(data, case), (math.inf, RIGS["straight"])
        stiffness = MODE_MASS / case.gain * _swing(measured) ** 2
        for damping in DAMPINGS:
            rig = ContactRig(round(stiffness, -2), damping, IMPACT_MASS, contact)
            off = _smooth_difference(measured, simulated_step(case, rig))
            best = min(best, (off, rig))
            yield Row(
                f"{case.profile} {case.name}, damping {damping:g} N s/m: rms of the difference [N]",
                f"{off:.3g}",
                "-",
            )
        yield Row(f"rig on {case.profile} {case.name}", " ".join(f"{value:g}" for value in best[1]), "-")


def _swing(step: ForceStep) -> float:
    """Frequency a force swings out with, 1 to 3.5 s after contact [rad/s]."""
    rows = (step.time > 1.0) & (step.time < 3.5)
    time, off = step.time[rows], step.force[rows] - step.force[rows].mean()
    tried = np.arange(3.0, 20.0, 0.05)
    return float(tried[np.abs(np.exp(-1j * np.outer(tried, time)) @ (off * np.hanning(len(off)))).argmax()])


def _smooth_difference(measured: ForceStep, simulated: ForceStep) -> float:
    t = np.arange(0.1, 3.0, 0.01)
    a, b = (
        np.convolve(np.interp(t, s.time, s.force), np.full(5, 0.2), "same") for s in (measured, simulated)
    )
    return float(np.sqrt(np.mean((a - b) ** 2)))


if __name__ == "__main__":
    rows = {
        "joints": joint_rows,
        "identify": identified_rows,
        "laws": law_rows,
        "mass": mass_rows,
        "fit": fit_rows,
        "flange": real_flange.flange_rows,
        "flange-fit": real_flange.fit_rows,
    }
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("forces", *rows))
    parser.add_argument("--data", type=Path, required=True, help="folder of the published data")
    parser.add_argument("--picture", type=Path, help="forces: curve on curve")
    given = parser.parse_args()
    curves: list[tuple[str, ForceStep, ForceStep]] = []
    made = force_rows(given.data, curves) if given.what == "forces" else rows[given.what](given.data)
    sides = ("gears' friction", "by speed") if given.what == "identify" else ("simulated", "measured")
    print_rows(f"A real UR10e: {given.what}", made, sides)
    if given.picture and curves:
        plot_steps(curves, "UR's force mode and force-mode").savefig(given.picture)
