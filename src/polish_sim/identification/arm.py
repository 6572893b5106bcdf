"""The robots that are identified: the cell's simulated arm, played and logged, and any robot a log is
from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from polish_sim.arms import ARMS
from polish_sim.arrays import Array
from polish_sim.cell.playback import JointTargets, play_joints
from polish_sim.cell.scene import arm_spec, bend_links, links_of, robot_with_tool
from polish_sim.config import RealArmConfig, RobotConfig
from polish_sim.errors import InputError, check_name
from polish_sim.identification import SCENARIO, STEP_S
from polish_sim.identification.elastic import KnownArm, SprungHead
from polish_sim.identification.excitation import (
    ClearanceCheck,
    FourierMotion,
    MotionLimits,
    started_and_stopped,
)
from polish_sim.identification.log_file import LoggedGears, RobotLog, read_by
from polish_sim.identification.model_file import RobotSource, read_robot_model
from polish_sim.identification.physical import Drawing
from polish_sim.identification.regressor import FULL, WAVES, States, TorqueModel
from polish_sim.identification.robot_model import (
    ARM_JOINTS,
    CarriedLoad,
    clearance_of,
    own_parameters,
    read_chain,
)
from polish_sim.motion.kinematics import NOMINAL, use_arm, used_arm
from polish_sim.motion.serial_chain import ChainGeometry

RAMP_S = 2.0
_TORQUE = np.array([150.0] * 3 + [28.0] * 3)
_LINK_DOUBT, _FRICTION_DOUBT = 0.15, 0.3


@dataclass(frozen=True)
class SimulatedArm:
    """The simulated arm."""

    robot: RobotConfig
    seed: int  #: Of its random numbers
    truth: TorqueModel  #: With the parameters of the compiled model, hidden from the identification
    carried: Array  #: Tool and head, known from the payload's calibration, shape (6, 10)
    servo_damping: Array  #: Speed gain of the servos [N m s/rad], shape (6,)
    clearance: ClearanceCheck
    load: CarriedLoad | None = None  #: Bolted to the last link, part of the truth
    known: KnownArm | None = None  #: What an identification of an elastic arm knows of it beforehand


def build_simulated_arm(
    robot: RobotConfig = SCENARIO.robot,
    seed: int = 0,
    load: CarriedLoad | None = None,
    warm_at: float = math.inf,
) -> SimulatedArm:
    """Compile the cell in free space and read its arm; the robot's gravity compensation must be exact.

    ``load``: what is bolted to the last link besides. Elastic joints have for
    truth their rotors and the friction of their motors without load, as warm as they are at ``warm_at`` [s].
    """
    real = robot.real
    model = _free_arm(replace(robot, payload_error=0.0), load)
    if robot.elastic:
        warm = 1.0 + real.cold_friction * math.exp(-warm_at / real.warming_s)
        model.dof_armature[:6], model.dof_frictionloss[:6] = (
            real.rotor_kg_m2,
            warm * np.array(real.coulomb_nm),
        )
        model.dof_damping.reshape(model.nv, -1)[:6, 0] = warm * np.array(real.viscous_nm_s_rad)
    chain = read_chain(model, ARM_JOINTS)
    carried = chain.parameters - own_parameters(model, ARM_JOINTS)
    clearance = clearance_of(model, 6, also=("head_pad",))
    truth = TorqueModel(chain)
    known = KnownArm(truth, real, _head_of(model), _bent(model, real)) if robot.elastic else None
    return SimulatedArm(robot, seed, truth, carried, -model.actuator_biasprm[:, 2], clearance, load, known)


def _free_arm(robot: RobotConfig, load: CarriedLoad | None) -> mujoco.MjModel:
    spec = robot_with_tool(replace(SCENARIO, robot=robot))
    if load is not None:
        link = spec.body("link_6")
        full = load.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        body = link.add_body(name="load", mass=load.mass, ipos=load.center, gravcomp=link.gravcomp)
        body.explicitinertial, body.fullinertia = True, full
    return spec.compile()


def _head_of(model: mujoco.MjModel) -> SprungHead:
    slide = model.joint("head_slide")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    flange = data.site("flange")
    center = flange.xmat.reshape(3, 3).T @ (data.body("head").xipos - flange.xpos)
    spring = model.jnt_stiffness[slide.id], model.dof_damping[slide.dofadr[0]]
    return SprungHead(model.body("head").mass[0], *spring, center)


def _bent(model: mujoco.MjModel, real: RealArmConfig) -> tuple[ChainGeometry, ...]:
    sizes = np.repeat(
        [real.angle_error_rad, real.length_error_m, real.length_error_m, real.angle_error_rad], 6
    )
    links = links_of(model)
    joints = [model.joint(name) for name in ARM_JOINTS]
    chains = []
    for step in np.diag(sizes):
        bend_links(links, joints, NOMINAL + step.reshape(NOMINAL.shape))
        chains.append(read_chain(model, ARM_JOINTS).geometry)
    bend_links(links, joints, NOMINAL)
    return tuple(chains)


def motion_limits() -> MotionLimits:
    """Limits of exciting motions: the shoulder stays above, nearly full speed, the servos' torques less a
    tenth."""
    turns = [[-0.9, 0.9], [-0.95, -0.05], [-0.85, 0.85], *[[-0.9, 0.9]] * 3]
    return MotionLimits(np.array(turns) * np.pi, np.full(6, 3.0), np.full(6, 12.0), 0.9 * _TORQUE)


def believe(arm: SimulatedArm, rng: np.random.Generator) -> Drawing:
    """A plausible drawing of the arm: links some 15% off as a whole, friction and rotors 30% off, the tool
    known."""
    n = 6
    own = (arm.truth.chain.parameters - arm.carried) * np.exp(_LINK_DOUBT * rng.normal(size=(n, 1)))
    friction = arm.truth.truth()[10 * n :]
    guessed = friction * np.exp(_FRICTION_DOUBT * rng.normal(size=len(friction)))
    return Drawing(np.concatenate([(own + arm.carried).ravel(), guessed]), arm.carried)


def play_motion(arm: SimulatedArm, motion: FourierMotion, periods: int, rate: float) -> RobotLog:
    """Play a periodic motion, entered and left along its own path, on the servos and log whole periods
    without noise.

    The log has ``rate`` [Hz], its time zero is the motion's.
    """
    span = periods * motion.period
    t: Array = np.arange(round((span + 2.0 * RAMP_S) / STEP_S) + 1) * np.float64(STEP_S)
    states = started_and_stopped(motion, t, RAMP_S, t[-1])
    log = play_states(arm, states)
    first = round(RAMP_S / STEP_S)
    rows = slice(first, first + round(span / STEP_S), round(1.0 / (rate * STEP_S)))
    return RobotLog(t[rows] - RAMP_S, log.q[rows], log.torque[rows], log.gears and log.gears.rows(rows))


def play_states(arm: SimulatedArm, states: States) -> RobotLog:
    """Play joint targets, one a physics step, and log positions and torques, gravity included.

    The engine's step is implicit in speed: the torque that moves the robot is the servo's at the end of the
    step. Its positions are half a step ahead of its speeds, so the change of speed over a step belongs to the
    step's first position. The engine compensates gravity, a real servo must hold it, so it is added. Of
    elastic joints the motors' torques are logged as they are.
    """
    played = play_joints(
        _free_arm(arm.robot, arm.load), arm.robot, arm.seed, JointTargets(states.q, states.qd)
    )
    time: Array = np.arange(len(played.q)) * np.float64(STEP_S)
    if arm.robot.elastic:
        step = arm.robot.real.encoder_rad
        return RobotLog(
            time,
            played.read,
            played.torque,
            LoggedGears(read_by(played.motor, step), read_by(played.q, step)),
        )
    change = np.diff(played.qd, axis=0, append=played.qd[-1:])
    links, still = replace(arm.truth, terms=()), np.zeros_like(played.q)
    gravity = links.torque(States(played.q, still, still), links.truth())
    return RobotLog(time, played.q, played.torque - arm.servo_damping * change + gravity)


@dataclass(frozen=True)
class LoggedRobot:
    """What is known of a robot beforehand."""

    model: TorqueModel  #: With the parameters of its drawing
    carried: Array  #: Part of the links that is known and stays: what is welded to them, shape (n, 10)
    source: RobotSource = None  #: Its MJCF; None for the cell's arm


def cell_arm() -> LoggedRobot:
    """The cell's UR5e with sensor, spindle and head."""
    arm = build_simulated_arm()
    return LoggedRobot(arm.truth, arm.carried)


def arm_of_table(name: str) -> LoggedRobot:
    """A make of arm without a tool, on strain-wave gears, by its table; InputError if there is none such."""
    check_name("arm", name, ARMS)
    used = used_arm()
    spec = arm_spec(name)
    spec.option.timestep = STEP_S
    use_arm(next(other for other, table in ARMS.items() if table is used))  # it is only looked at
    for key in list(spec.keys):
        spec.delete(key)
    spec.delete(spec.body("tool_mount"))
    spec.modelname = name
    chain = read_chain(spec.compile(), ARM_JOINTS)
    teeth = round(2.0 * SCENARIO.robot.real.gear_ratio)  # two more than the cup inside has
    waves = (f"{wave}{count}" for count in (teeth - 2, teeth) for wave in WAVES)
    model = TorqueModel(chain, (*FULL, "root", "load", *waves), chain.parameters.ravel())
    return LoggedRobot(model, np.zeros_like(chain.parameters), spec)


def robot_of_file(file: Path, joints: Sequence[str] | None) -> LoggedRobot:
    """A robot of a user's own MJCF; joints not named are held where the model starts, with None all are the
    chain's.

    Raises InputError if the file is no model, or holds no serial chain of hinges and slides; names the joint.
    """
    compiled = read_robot_model(file)
    try:
        chain = read_chain(compiled, joints)
        own = own_parameters(compiled, chain.joints)
    except InputError as error:
        raise InputError(f"'{file}': {error}") from None
    return LoggedRobot(TorqueModel(chain), chain.parameters - own, file)
