"""A log's motion replayed in free space: what the simulated arm does and needs for it, and torques, ripple
and friction of its joints beside the robot's, as table, picture
and page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from polish_sim.analysis.style import BLUE, ORANGE, head, new_figure, say_instead, styled
from polish_sim.arms import arm_table
from polish_sim.arrays import Array, midpoints
from polish_sim.cell.playback import JointTargets, play_joints
from polish_sim.cell.real_arm import take_arm
from polish_sim.cell.scene import build_scene
from polish_sim.compare.figures import (
    BAND_N,
    SPEEDS,
    WINDOW_S,
    ForceStep,
    delay,
    fit_friction,
    friction_curve,
    moves_both_ways,
    ripple,
)
from polish_sim.config import RobotConfig, Scenario, SpindleConfig
from polish_sim.errors import InputError
from polish_sim.exchange.robot_log import RobotRecording
from polish_sim.experiments.run_page import scene_bodies, scene_solids, shown_rows
from polish_sim.identification.estimate import torque_error
from polish_sim.page import Table, figure_rows, number_or_dash
from polish_sim.page.page import Line, Motion, Page, Plot
from polish_sim.planning.toolpath import interpolate

SCENARIO = Scenario(experiment="compare", robot=RobotConfig(), spindle=SpindleConfig(speed_rpm=0.0))
MOTION_HZ = 4.0  #: What of a measured motion was commanded [Hz]
CLOCK_S = 0.005  #: On which it is looked at [s]
LEAD_S = 0.5  #: In which the arm gets up to the speed a log begins with [s]
_NO_TOOL = 1e-3  #: Mass of a tool that is not there [kg]


class CarriedPayload(NamedTuple):
    """What the real arm carried."""

    mass: float = 0.0  #: [kg]
    center: tuple[float, ...] = (0.0, 0.0, 0.0)  #: From the flange, its axes [m]


class Replay(NamedTuple):
    """The simulated arm at the log's times, shape (n, 6)."""

    q: Array  #: By the encoders [rad]
    qd: Array  #: [rad/s]
    torque: Array  #: Of the motors, the arm's weight included [N m]


def replay(robot: RobotConfig, log: RobotRecording, payload: CarriedPayload) -> Replay:
    """Play a log's commanded joints, or its measured ones, on the servos of an arm.

    The arm is bare but for the ``payload``, which its controller does not know. A log that begins in
    motion gets a run-up to its start.

    Raises:
        ReachError: Links would touch each other.
        ProtectiveStop: The simulation ran away.
    """
    model = bare_arm(robot, payload)
    dt = model.opt.timestep
    wanted = commands_of(log)
    t = np.arange(-round(LEAD_S / dt), round(log.time[-1] / dt) + 1) * dt
    inside = np.maximum(t, 0.0)
    q, qd = wanted(inside), wanted(inside, 1)
    # From rest to the first speed at a constant acceleration.
    lead = t < 0.0
    first = qd[0]
    share = 1.0 + t[lead, None] / LEAD_S
    q[lead] = q[0] - first * LEAD_S * 0.5 * (1.0 - share**2)
    qd[lead] = first * share
    played = play_joints(model, robot, SCENARIO.seed, JointTargets(q, qd))
    still = np.zeros_like(q)
    if not robot.elastic:
        played.torque[:] += rigid_torques(robot, played.q, still, still, payload)
    return Replay(*(
        interpolate(log.time, t, values)
        for values in (played.read, played.qd, played.torque)
    ))  # fmt: skip


def commands_of(log: RobotRecording) -> CubicSpline:
    """The commanded joints over the log's time; those measured if it has none, without what their gears add.

    A measured motion repeats its gears' error 202 times a turn: played as a command, the rotors' inertia
    would make torque of it. It is low-passed, forwards and backwards, at `MOTION_HZ`.
    """
    if "q_desired_rad" in log.values:
        return CubicSpline(log.time, log.values["q_desired_rad"])
    t = np.arange(log.time[0], log.time[-1], CLOCK_S)
    if len(t) < 2:
        raise InputError(f"the log is {log.time[-1] - log.time[0]:.2g} s long: too short to be replayed.")
    q = CubicSpline(log.time, log.values["q_rad"])(t)
    low = butter(2, MOTION_HZ, fs=1.0 / CLOCK_S, output="sos")
    return CubicSpline(
        t, sosfiltfilt(low, q, axis=0, padtype="odd", padlen=min(len(t) - 1, round(1.0 / CLOCK_S)))
    )


def rigid_torques(robot: RobotConfig, q: Array, qd: Array, qdd: Array, payload: CarriedPayload) -> Array:
    """Torques the bare arm with its rotors and payload takes without friction, (n, 6) [N m]."""
    model = bare_arm(robot, payload)
    model.body_gravcomp[:] = model.dof_frictionloss[:] = model.dof_damping[:] = 0.0
    model.dof_armature[:6] = robot.real.rotor_kg_m2
    model.jnt_stiffness[:] = 0.0
    data = mujoco.MjData(model)
    torques = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:6] = q[k]
        data.qvel[:6] = qd[k]
        data.qacc[:6] = qdd[k]
        mujoco.mj_inverse(model, data)
        torques[k] = data.qfrc_inverse[:6]
    return torques


def bare_arm(robot: RobotConfig, payload: CarriedPayload) -> mujoco.MjModel:
    """Compile an arm in free space, a payload on its flange for its tool; the robot compensates neither."""
    model = build_scene(replace(SCENARIO, robot=robot))
    mount = model.body("tool_mount").id
    head = model.body("head").id
    for body, mass in ((mount, max(payload.mass, _NO_TOOL)), (head, _NO_TOOL)):
        scale = mass / model.body_mass[body]
        model.body_inertia[body] *= scale
        model.body_mass[body] *= scale
    model.body_ipos[mount] = payload.center
    model.body_gravcomp[mount] = 0.0
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def warm(robot: RobotConfig) -> RobotConfig:
    """The arm warm, its table exact and no packet missed: logs do not show these."""
    real = replace(robot.real, cold_friction=0.0, kinematics="exact", missed_every_s=0.0)
    return replace(robot, real=real)


JOINTS = range(6)
SURE = 2.0  #: Standard errors above zero from which a figure of friction is shown
_SHARP = 0.01  #: Speed in which Coulomb's friction changes its sign where it is taken off [rad/s]


class JointComparison(NamedTuple):
    """Curves on the log's rows and what was measured of them."""

    time: Array  #: [s], shape (n,)
    measured_q: Array  #: [rad], shape (n, 6)
    simulated_q: Array
    measured: Array  #: Torques [N m], shape (n, 6); empty, (0, 6), if the log has none
    simulated: Array
    curves: Array  #: Friction by speed, measured and simulated, shape (2, 6, k) [N m]
    figures: dict[str, Any]


def compare_joints(robot: RobotConfig, log: RobotRecording, payload: CarriedPayload) -> JointComparison:
    """Replay a log and measure both sides alike; raises as `replay`."""
    take_arm(robot)
    robot = warm(robot)
    played = replay(robot, log, payload)
    measured = log.torques(arm_table(robot.arm).torque_constants)
    q = log.values["q_rad"]
    commands = commands_of(log)
    qd = commands(log.time, 1)
    both = moves_both_ways(qd)
    figures: dict[str, Any] = {
        "motion_delay_s": delay(log.time, q[:, both], played.q[:, both]),
        "motion_rms_rad": np.sqrt(np.mean((q - played.q) ** 2, axis=0)).tolist(),
    }
    curves = np.full((2, 6, len(SPEEDS) - 1), np.nan)
    if len(measured):
        qdd = commands(log.time, 2)
        rigid = rigid_torques(robot, commands(log.time), qd, qdd, payload)
        figures |= {
            "nrms": torque_error(played.torque, measured).tolist(),
            "delay_s": delay(log.time, measured[:, both], played.torque[:, both]),
        }
        for side, (torque, prefix) in enumerate(((measured, ""), (played.torque, "simulated_"))):
            found = [_one_joint(log.time, q[:, j], qd[:, j], torque[:, j], rigid[:, j]) for j in JOINTS]
            figures |= {prefix + name: [one[name] for one in found] for name in found[0]}
            curves[side] = [friction_curve(qd[:, j], torque[:, j], rigid[:, j]) for j in JOINTS]
        curves[:, ~both] = np.nan
        off = curves[1] / curves[0] - 1.0
        figures["friction_curve_error"] = [_largest(row) for row in off]
    return JointComparison(log.time, q, played.q, measured, played.torque, curves, figures)


def _one_joint(time: Array, q: Array, qd: Array, torque: Array, rigid: Array) -> dict[str, float]:
    found, errors = fit_friction(qd, torque, rigid)
    sign = np.tanh(qd / _SHARP)
    share = np.where(rigid * qd > 0.0, found.driving, found.driven)
    rubbing = sign * (found.coulomb + found.viscous * np.abs(qd) + share * np.abs(rigid))
    line = ripple(time, q, qd, torque - rigid - rubbing)
    names = ("ripple_cycles", "ripple_nm", "coulomb_nm", "viscous_nm_s_rad", "driving", "driven")
    shown = np.where(moves_both_ways(qd) & (found > SURE * errors), found, np.nan)
    return dict(zip(names, (*line, *shown), strict=True))


def _largest(values: Array) -> float:
    there = values[np.isfinite(values)]
    return float(there[np.abs(there).argmax()]) if len(there) else float("nan")


# A comparison as table, picture and page.


FIGURES = "compare.json"
PICTURE = "compare.png"
_LABELS = {
    "nrms": ("torque, rms of the difference", "% of its range", 100.0),
    "ripple_cycles": ("ripple", "1/turn", 1.0),
    "ripple_nm": ("  amplitude", "N m", 1.0),
    "coulomb_nm": ("friction, Coulomb", "N m", 1.0),
    "viscous_nm_s_rad": ("  viscous", "N m s/rad", 1.0),
    "driving": ("  of the load, driving", "%", 100.0),
    "driven": ("  of the load, driven", "%", 100.0),
    "friction_curve_error": ("friction by speed, largest", "% off", 100.0),
}
STEP_ROWS = (
    (f"settling to ±{BAND_N:g} N", "s", "settling_s", ".4g"),
    ("mean error", "N", "mean_error_n", ".4g"),
    ("peak", "N", "peak_n", ".4g"),
    ("in the air after contact", "s", "lost_s", ".4g"),
    (f"mean of the last {WINDOW_S / 3.0:g} s, off by", "N", "late_error_n", ".4g"),
)  #: Of a force step
ONE_SIDED = ("nrms", "friction_curve_error")  #: Of both sides at once


def joint_table(title: str, figures: dict[str, Any]) -> Table:
    """Measured beside simulated by joint."""
    rows = []
    for name, (label, unit, scale) in _LABELS.items():
        for side, key in (("measured", name), ("simulated", f"simulated_{name}")):
            if key in figures:
                cells = (number_or_dash(value, ".4g", scale) for value in figures[key])
                rows.append([label, unit, "" if name in ONE_SIDED else side, *cells])
    caption = (
        f"measured behind simulated: motion {number_or_dash(figures['motion_delay_s'], '.1f', 1e3)} ms, "
        f"torque {number_or_dash(figures.get('delay_s'), '.1f', 1e3)} ms"
    )
    if np.isnan(figures.get("coulomb_nm", 0.0)).any():
        caption += f"; friction -: below {SURE:g} standard errors, or the joint moves one way only"
    return Table(title, ["figure", "unit", "side", *(f"joint {j + 1}" for j in JOINTS)], rows, 3, caption)


def step_table(title: str, figures: dict[str, Any]) -> Table:
    """A force step, measured beside simulated."""
    simulated = {name: figures.get(f"simulated_{name}") for name in figures}
    caption = f"rms of the difference of the curves: {number_or_dash(figures['force_rms_n'], '.4g')} N"
    rows = figure_rows(STEP_ROWS, figures, simulated)
    return Table(title, ["figure", "unit", "measured", "simulated"], rows, 2, caption)


@styled
def plot_joint_torques(found: JointComparison, title: str) -> Figure:
    """Torque over time and friction by speed of each joint, measured and simulated."""
    figure = new_figure(12.0, 14.0)
    grid = figure.subplots(6, 2, width_ratios=(2.2, 1.0))
    middle = midpoints(SPEEDS)
    for j in JOINTS:
        over_time, by_speed = grid[j]
        for values, friction, color, name in (
            (found.measured, found.curves[0], ORANGE, "measured"),
            (found.simulated, found.curves[1], BLUE, "simulated"),
        ):
            if len(values):
                over_time.plot(found.time, values[:, j], color=color, linewidth=0.7, label=name)
            by_speed.plot(middle, friction[j], "o-", color=color, markersize=3, linewidth=1.0)
        over_time.set_ylabel(f"joint {j + 1} [N m]")
        by_speed.set_ylim(bottom=0.0)
        if np.isnan(found.curves[:, j]).all():
            say_instead(by_speed, "too little motion both ways")
    grid[0, 0].set_title("torque")
    grid[0, 1].set_title("friction [N m]")
    grid[5, 0].set_xlabel("time [s]")
    grid[5, 1].set_xlabel("speed [rad/s]")
    head(figure, title, ["orange: measured, blue: simulated"], legend=(grid[0, 0],))
    return figure


@styled
def plot_steps(pairs: Sequence[tuple[str, ForceStep, ForceStep]], title: str) -> Figure:
    """Forces since first contact, measured and simulated, one panel a case."""
    wide = min(2, len(pairs))
    high = -(-len(pairs) // wide)
    figure = new_figure(6.0 * wide, 1.2 + 2.2 * high)
    grid = figure.subplots(high, wide, squeeze=False).ravel()
    for axes, (name, measured, simulated) in zip(grid, pairs, strict=False):
        for step, color, side in ((measured, ORANGE, "measured"), (simulated, BLUE, "simulated")):
            inside = (step.time > -0.1) & (step.time < WINDOW_S)
            axes.plot(step.time[inside], step.force[inside], color=color, linewidth=0.7, label=side)
        axes.axhline(measured.asked, color="#444444", linewidth=0.6, linestyle=":")
        axes.set(title=name, xlim=(-0.1, WINDOW_S), ylabel="force [N]")
    for axes in grid[len(pairs) :]:
        axes.set_visible(False)
    head(figure, title, ["seconds since first contact"], legend=(grid[0],))
    return figure


def joint_page(found: JointComparison, model: mujoco.MjModel, title: str) -> Page:
    """The replayed arm, drawn by a ``model``, in motion over its torques, measured and simulated."""
    kept = shown_rows(found.time, found.simulated_q)
    time = found.time[kept]
    still = np.full(len(kept), np.nan)
    joints = np.column_stack([found.simulated_q[kept], np.zeros((len(kept), model.nq - 6))])
    pad = np.zeros((len(kept), 3))
    plots = [
        Plot(f"joint {j + 1}, {what}", unit, _lines(measured, simulated, kept, j))
        for what, unit, measured, simulated in (
            ("torque", "N m", found.measured, found.simulated),
            ("angle", "rad", found.measured_q, found.simulated_q),
        )
        for j in JOINTS
    ]
    tables = [joint_table("By joint", found.figures)]
    return Page.of(title, "a robot's log beside its replay", tables)._replace(
        bodies=scene_bodies(model),
        solids=scene_solids(model),
        plots=plots,
        motion=Motion(time, joints, pad, still, still, still, still, still),
    )


def _lines(measured: Array, simulated: Array, kept: Any, j: int) -> list[Line]:
    lines = [Line("simulated", simulated[kept, j])]
    return [Line("measured", measured[kept, j], "asked"), *lines] if len(measured) else lines


def step_page(figures: dict[str, Any], title: str) -> Page:
    """A force step's figures as a page."""
    return Page.of(title, "a robot's force beside a simulated run's", [step_table("Force step", figures)])
