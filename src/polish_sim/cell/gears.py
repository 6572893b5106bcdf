"""Elastic joints with rotors of their own: motor -> rotor -> gear -> link, as a UR5e's are; and the arm its
host sees.

The engine moves the links. Each rotor is one equation here, at the joint's scale (angle of the motor by the
ratio):

    J dw/dt = servo + weight - friction - (1 + error') torque
    torque = elastic(twist) + hysteresis + D d(twist)/dt
    twist = rotor + error(rotor) - joint

The gear's elastic torque is taken at the step's beginning, everything that damps at its end, for rotor and
link
together: the rotor's speed is eliminated, what is left damps the joint and goes to the engine's implicit
integrator. So both feel the same torque, springs neither gain nor lose, and stiff wrists stay stable at 1 ms.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.engine import EngineViews
from polish_sim.control.signals import Measurement
from polish_sim.kernels import (
    Matrix3,
    Matrix4,
    Record,
    Vector3,
    Vector6,
    cross,
    dot,
    kernel,
    minus,
    plus_matvec,
    set_to,
)
from polish_sim.motion.kinematics import advance_frame, joint_rows

PRESSED_S = 0.2  #: In which the host believes a force to stay [s]
Slopes = Annotated[Array, (6, 3)]
Knees = Annotated[Array, (6, 2)]


# An arm as its host computes it: tool pose and axes from joint angles and a table of Denavit-Hartenberg
# parameters.


class HostArm(Record):
    """An arm by a table; where axes and end are is written by ``read_encoders``, world frame."""

    table: Annotated[Array, (6, 5)]  #: As `joint_rows`
    T_world_base: Matrix4  #: Where the arm stands
    T_flange_end: Matrix4  #: Its end, tool or flange itself
    gears: Annotated[Array, (6, 7)]  #: Turn its links off the encoders, see `compensate`; 0: they do not
    anchors: Annotated[Array, (6, 3)]  #: A point on each joint's axis [m]
    axes: Annotated[Array, (6, 3)]  #: Unit axes
    place: Vector3  #: The end [m]
    turn: Matrix3  #: Rotation of the end
    frame: Annotated[Array, (3, 4)]  #: Work array


def build_host_arm(
    table: Array, T_world_base: Array, T_flange_end: Array, gears: Array | float = 0.0
) -> HostArm:
    """A host that computes with a table, (4, 6), and ``gears`` (6, 7) for an arm at ``T_world_base`` with its
    end at ``T_flange_end``."""
    return HostArm(joint_rows(table), T_world_base, T_flange_end, np.zeros((6, 7)) + gears)


@kernel
def read_encoders(arm: HostArm, q: Array) -> None:
    """Where axes and end are with joint angles ``q`` (>= 6,) [rad], by the host's table."""
    T = arm.frame
    for i in range(3):
        for j in range(4):
            T[i, j] = arm.T_world_base[i, j]
    for k in range(6):
        for i in range(3):
            arm.anchors[k, i], arm.axes[k, i] = T[i, 3], T[i, 2]
        advance_frame(T, arm.table[k], q[k])
    E = arm.T_flange_end
    set_to(arm.place, plus_matvec(T[:, 3], T, E[:, 3]))
    for i in range(3):
        for j in range(3):
            arm.turn[i, j] = dot(T[i], E[:, j])


# The joints.


class RealArm(Record):
    """Settings and state of the joints, and the arm as the host computes it; all zero for a rigid arm, whose
    links the engine's servos move."""

    elastic: bool
    stiffness: Slopes  #: Between the knees [N m/rad]
    knees: Knees  #: Torques at which it changes [N m]
    bends: Knees  #: Twists there [rad]
    coupling: Vector6  #: Damping of the gears in the step [N m s/rad]
    lost_torque: Vector6  #: Largest torque of the hysteresis [N m]
    rise: float  #: Twist in which it builds up [rad]
    inertia: Vector6  #: Rotors [kg m^2]
    waves: float  #: Periods of the gears' error in a turn of the joint
    error: Annotated[Array, (6, 4)]  #: Factors of its sine, cosine and of those of twice the angle [rad]
    viscous: Vector6  #: [N m s/rad]
    coulomb: Vector6  #: [N m]
    driving: float  #: More of it by the gear's torque, when the motor drives [-]
    driven: float  #: When the load drives [-]
    cold: float  #: Share of friction more than warm, at the start [-]
    warming: float  #: [s]
    kp: Vector6  #: Servos [N m/rad]
    kv: Vector6  #: [N m s/rad]
    limit: Vector6  #: Of the motors [N m]
    lag: float  #: Share of the way to the command that the set point goes in a step [-]
    on_link: bool  #: The position is controlled and read on the link's side
    link_rate: float  #: Share of the position error corrected in a step there [-]
    encoder: float  #: Step [rad]
    missed_steps: int  #: Steps a gap in the link to the host lasts
    missed_mean: float  #: Steps between gaps, on average; 0 for none
    missed_next: int  #: Step at which the next gap begins
    dice: int  #: Random number for the next one
    waited: int  #: Steps since the host last acted
    heard: bool  #: Whether it acted in the last step
    set_point: Vector6  #: [rad]
    set_speed: Vector6  #: [rad/s]
    correction: Vector6  #: Of the set point, by the encoders on the link's side [rad]
    angle: Vector6  #: Rotors [rad]
    speed: Vector6  #: [rad/s]
    twist: Vector6  #: Of the gears [rad]
    ratio: Vector6  #: 1 + error' at this instant [-]
    hysteresis: Vector6  #: [N m]
    torque: Vector6  #: Of the gears' springs, hysteresis included [N m]
    push: Vector6  #: Motor torque at rest, and what its speed takes off
    stiffened: Vector6  #: [N m s/rad]
    dry: Vector6  #: Coulomb friction in this step [N m]
    free: Vector6  #: Rotor speed after the step if the joint stood still [rad/s]
    share: Vector6  #: Of the joint's speed that the rotor takes on [-]
    read: Vector6  #: Joint angles as the host receives them [rad]
    read_speed: Vector6  #: [rad/s]
    links: Vector6  #: The links' angles the host takes them for [rad]
    link_speed: Vector6  #: [rad/s]
    slope: Vector6  #: Of the links' angles by the encoders' [-]
    pressed: float  #: Force that winds it up, as the host knows it [N]
    first: int  #: Of its joints in the engine
    first_control: int  #: Of its servos' controls
    host: HostArm
    tool_speed: float  #: Exact speed of the tool point [m/s]


@kernel
def elastic_torque(arm: RealArm, j: int, twist: float) -> float:
    """Torque of the spring of gear ``j``, three slopes [N m]."""
    size = abs(twist)
    if size <= arm.bends[j, 0]:
        torque = arm.stiffness[j, 0] * size
    elif size <= arm.bends[j, 1]:
        torque = arm.knees[j, 0] + arm.stiffness[j, 1] * (size - arm.bends[j, 0])
    else:
        torque = arm.knees[j, 1] + arm.stiffness[j, 2] * (size - arm.bends[j, 1])
    return math.copysign(torque, twist)


@kernel
def with_error(angle: float, a: Array, waves: float, at: float) -> tuple[float, float]:
    """An angle with a gear's error at the angle ``at`` [rad], and the slope; ``a`` (4,) as in `RealArm`."""
    s, c = math.sin(waves * at), math.cos(waves * at)
    s2, c2 = 2.0 * s * c, c * c - s * s
    turned = angle + a[0] * s + a[1] * c + a[2] * s2 + a[3] * c2
    return turned, 1.0 + waves * (a[0] * c - a[1] * s + 2.0 * (a[2] * c2 - a[3] * s2))


@kernel
def slip(torque: float, moved: float, most: float, rise: float) -> float:
    """Torque of the hysteresis (Dahl) [N m] after the gear twisted by ``moved`` [rad]: towards ``most``
    against it."""
    most = math.copysign(most, moved)
    return most + (torque - most) * math.exp(-abs(moved) / rise)


@kernel
def hear_joints(arm: RealArm, e: EngineViews) -> None:
    """Joint angles and speeds as the encoders give them."""
    for j in range(6):
        i = arm.first + j
        angle = e.qpos[i] if arm.on_link else arm.angle[j]
        arm.read[j] = math.floor(angle / arm.encoder + 0.5) * arm.encoder if arm.encoder > 0.0 else angle
        arm.read_speed[j] = e.qvel[i] if arm.on_link else arm.speed[j]


@kernel
def compensate(arm: RealArm, host: HostArm, e: EngineViews, m: Measurement, share: float) -> None:
    """The links' angles for the encoders', by what the host knows of the gears: wind-up under the weight they
    carry and the force pressed with, by parts between the knees, and error once and twice a period.

    ``share``: of the tool's force that pushes on this arm, -1 where it carries the part. The force is taken
    as read, but slowly: the reading holds the tool's inertia, which is no load that stays.
    """
    if math.isfinite(m.wrench[2]):
        arm.pressed += e.dt / PRESSED_S * (share * m.wrench[2] - arm.pressed)
    for j in range(6):
        g, lever = host.gears[j], minus(m.position, host.anchors[j])
        moment_arm = dot(host.axes[j], cross(lever, m.rotation[:, 2]))
        load = e.qfrc_gravcomp[arm.first + j] + arm.pressed * moment_arm
        size, first, second = abs(load), arm.knees[j, 0], arm.knees[j, 1]
        wound = g[0] * min(size, first) + g[1] * min(max(size - first, 0.0), second - first)
        wound += g[2] * max(size - second, 0.0)
        wound = wound if load > 0.0 else -wound
        arm.links[j], arm.slope[j] = with_error(arm.read[j] - wound, g[3:7], arm.waves, arm.read[j])
        arm.link_speed[j] = arm.slope[j] * arm.read_speed[j]


@kernel
def host_hears(arm: RealArm, due: bool, step: int) -> bool:
    """Whether the host acts at this step, at which it is due or not; ``waited`` are the steps since it last
    did."""
    arm.waited = 1 if arm.heard else arm.waited + 1
    arm.heard = False
    if arm.missed_mean > 0.0 and step >= arm.missed_next:
        if step < arm.missed_next + arm.missed_steps:
            return False
        arm.dice = (arm.dice * 1103515245 + 12345) % 2147483648
        arm.missed_next = step + 1 - int(arm.missed_mean * math.log((arm.dice + 1.0) / 2147483648.0))
    arm.heard = due
    return due


@kernel
def drive_joints(arm: RealArm, e: EngineViews, t: float) -> None:
    """Servos, rotors and gears up to the engine's step: the torques the joints get, and what damps them in
    it.

    Between ``mj_step1`` and ``mj_step2``; rigid ones are the engine's. The weight the robot carries for
    itself is the motors' here, not the links'.
    """
    if not arm.elastic:
        return
    for j in range(6):
        i, control = arm.first + j, arm.first_control + 2 * j
        arm.set_point[j] += arm.lag * (e.ctrl[control] - arm.set_point[j])
        arm.set_speed[j] += arm.lag * (e.ctrl[control + 1] - arm.set_speed[j])
        if arm.on_link:
            arm.correction[j] += arm.link_rate * (arm.set_point[j] - arm.read[j])
        seen = arm.read[j] if not arm.on_link else arm.angle[j]
        arm.push[j] = arm.kp[j] * (arm.set_point[j] + arm.correction[j] - seen) + arm.kv[j] * arm.set_speed[j]
        arm.push[j] += e.qfrc_gravcomp[i]
        arm.stiffened[j] = arm.kv[j]
    turn_rotors(arm, e, t)


@kernel
def turn_rotors(arm: RealArm, e: EngineViews, t: float) -> None:
    """Rotors and gears under motors that give ``push`` less ``stiffened`` times the rotor's speed; see
    drive_joints."""
    dt = e.dt
    warm = 1.0 + arm.cold * math.exp(-t / arm.warming)
    for j in range(6):
        i = arm.first + j
        weight, b, k = e.qfrc_gravcomp[i], arm.coupling[j], arm.ratio[j]
        push, stiff = arm.push[j], arm.stiffened[j]
        torque = elastic_torque(arm, j, arm.twist[j]) + arm.hysteresis[j]
        momentum = arm.inertia[j] * arm.speed[j] - dt * k * torque
        damped = arm.inertia[j] + dt * (warm * arm.viscous[j] + k * k * b)
        # As fast as it would be without dry friction and with the joint's speed as it is.
        carried = dt * k * b * e.qvel[i]
        motor = push - stiff * (momentum + carried + dt * push) / (damped + dt * stiff)
        if abs(motor) > arm.limit[j]:
            push = math.copysign(arm.limit[j], motor)
            stiff = 0.0
        damped += dt * stiff
        speed = (momentum + carried + dt * push) / damped
        load = arm.driving if torque * speed > 0.0 else arm.driven
        most = warm * (arm.coulomb[j] + load * abs(torque))
        dry = math.copysign(min(most, damped * abs(speed) / dt), speed)
        arm.torque[j], arm.push[j], arm.stiffened[j], arm.dry[j] = torque, push, stiff, dry
        arm.free[j] = (momentum + dt * (push - dry)) / damped
        arm.share[j] = dt * k * b / damped
        # The engine has taken the joint's damping of the last step into its forces already.
        left = b * (1.0 - k * arm.share[j])
        e.qfrc_applied[i] = torque + b * k * arm.free[j] - weight + (e.dof_damping[i] - left) * e.qvel[i]
        e.dof_damping[i] = left


@kernel
def follow_rotors(arm: RealArm, e: EngineViews) -> None:
    """Rotors, twists and hysteresis after the engine's step; the motors' torques where the engine has its
    own. Rigid joints have none."""
    if not arm.elastic:
        return
    for j in range(6):
        i = arm.first + j
        speed = arm.free[j] + arm.share[j] * e.qvel[i]
        arm.speed[j] = speed
        arm.angle[j] += e.dt * speed
        turned, arm.ratio[j] = with_error(arm.angle[j], arm.error[j], arm.waves, arm.angle[j])
        moved = turned - e.qpos[i] - arm.twist[j]
        arm.hysteresis[j] = slip(arm.hysteresis[j], moved, arm.lost_torque[j], arm.rise)
        arm.twist[j] = turned - e.qpos[i]
        e.qfrc_actuator[i] = arm.push[j] - arm.stiffened[j] * speed
