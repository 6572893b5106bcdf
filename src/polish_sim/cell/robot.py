"""The robot: its velocity interface ``speedl(twist, acceleration, time)`` down to the joint servos, and its
stops.

The commanded tool velocity follows the request within linear and angular acceleration limits, acts after a
latency and decelerates to rest by itself when the time given runs out. Joint speeds come from the damped
inverse of the Jacobian at the measured joints; they are scaled to their limits together, so that the
direction is kept.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.config import RobotConfig, SafetyConfig
from polish_sim.control.signals import Measurement
from polish_sim.kernels import (
    Bundle,
    Matrix6,
    Record,
    Vector3,
    Vector6,
    add_to,
    dot,
    kernel,
    minus,
    scaled,
    solve_positive,
)
from polish_sim.motion import JOINT_LIMITS

SPARE = 200  # steps the latency can grow by while running
_PROBE_EVERY = 8  # steps between looks at how near a singularity is


class Speedl(Record):
    """Limits and memory of the interface."""

    latency: int  #: Steps from request to action
    acceleration: float  #: [m/s^2]
    angular_acceleration: float  #: [rad/s^2]
    timeout: float  #: A request holds this long [s]
    joint_speed: float  #: [rad/s]
    lowest: Vector6  #: Joint positions [rad]
    highest: Vector6  #: Joint positions [rad]
    damping_onset: float  #: Smallest singular value below which the inverse is damped [-]
    steps: int  #: Steps taken
    twist: Vector6  #: Tool velocity commanded now
    request: Vector6  #: Twist of the request acting now
    number: int  #: Of that request; 0 before the first
    age: float  #: Of that request [s]
    weakest: float  #: Smallest singular value of the Jacobian [-]
    joints: Vector6  #: Commanded joint positions [rad]
    speeds: Vector6  #: Commanded joint speeds [rad/s]
    probe: Vector6  #: Running estimate of the weakest direction
    gram: Matrix6  #: Work array
    solution: Vector6  #: Work array


class RequestLine(Bundle):
    """Requests on their way to the robot, one a step."""

    twists: Array  #: Shape (latency + SPARE + 1, 6)
    numbers: NDArray[np.int64]  #: Their numbers, shape (latency + SPARE + 1,)


def build_speedl(robot: RobotConfig, safety: SafetyConfig, dt: float, joints: Array) -> Speedl:
    """The velocity interface of a robot at rest at ``joints`` [rad], shape (6,), stepped by ``dt`` [s]."""
    return Speedl(
        latency=round(robot.command_latency_s / dt),
        acceleration=robot.linear_acceleration_m_s2, angular_acceleration=robot.angular_acceleration_rad_s2,
        timeout=robot.command_timeout_s, joint_speed=robot.joint_speed_limit_rad_s,
        lowest=JOINT_LIMITS[:, 0], highest=JOINT_LIMITS[:, 1],
        damping_onset=2.0 * safety.singular_value_limit, weakest=1.0, joints=joints,
        probe=np.full(6, 1.0 / math.sqrt(6.0)),
    )  # fmt: skip


def build_request_line(robot: Speedl) -> RequestLine:
    """An empty line."""
    length = int(robot.latency) + SPARE + 1
    return RequestLine(np.zeros((length, 6)), np.zeros(length, np.int64))


@kernel
def pass_request(robot: Speedl, line: RequestLine, requested: Array, number: int, dt: float) -> None:
    """Send the newest request down the line and let the one that arrives act: ``request``, its number and its
    age.

    ``requested`` (>= 6,) is the twist the host asked for last, ``number`` counts its requests.
    """
    robot.steps += 1
    length = line.numbers.shape[0]
    slot = robot.steps % length
    for i in range(6):
        line.twists[slot, i] = requested[i]
    line.numbers[slot] = number
    due = (slot - robot.latency) % length
    if line.numbers[due] > robot.number:
        for i in range(6):
            robot.request[i] = line.twists[due, i]
        robot.number = line.numbers[due]
        robot.age = 0.0
    else:
        robot.age += dt


@kernel
def limit_acceleration(robot: Speedl, dt: float, firmness: float) -> None:
    """Move the commanded twist toward the acting request within ``firmness`` times the acceleration
    limits."""
    alive = 1.0 if robot.age < robot.timeout else 0.0
    for start, limit in ((0, firmness * robot.acceleration), (3, firmness * robot.angular_acceleration)):
        twist = robot.twist[start:]
        gap = minus(scaled(alive, robot.request[start:]), twist)
        size = math.sqrt(dot(gap, gap))
        add_to(twist, scaled(1.0 if size <= limit * dt else limit * dt / size, gap))


@kernel
def resolve_joints(robot: Speedl, jacobian: Array, dt: float) -> bool:
    """Joint speeds for the commanded twist, and the joint positions they lead to; also the smallest singular
    value.

    ``jacobian`` (6, 6) is the geometric one at the tool point, base frame. Returns False if a joint would
    leave its range; it is held there.
    """
    A, y = robot.gram, robot.solution
    if robot.steps % _PROBE_EVERY == 0:
        _gram(jacobian, 0.0, A)
        robot.weakest = _weakest_direction(A, robot.probe, y)
    # Damping grows from nothing at the onset, so that the inverse is exact away from singularities.
    damping = 0.5 * max(robot.damping_onset - robot.weakest, 0.0)
    _gram(jacobian, damping * damping, A)
    solve_positive(A, robot.twist, y)
    fastest = 0.0
    for j in range(6):
        total = 0.0
        for i in range(6):
            total += jacobian[i, j] * y[i]
        robot.speeds[j] = total
        fastest = max(fastest, abs(total))
    scale = 1.0 if fastest <= robot.joint_speed else robot.joint_speed / fastest
    inside = True
    for j in range(6):
        robot.speeds[j] *= scale
        wanted = robot.joints[j] + robot.speeds[j] * dt
        if wanted < robot.lowest[j] or wanted > robot.highest[j]:
            inside = False
            robot.speeds[j] = 0.0
        else:
            robot.joints[j] = wanted
    return inside


@kernel
def _gram(jacobian: Array, damping: float, A: Array) -> None:
    """Lower triangle of J J^T, damped."""
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(6):
                total += jacobian[i, k] * jacobian[j, k]
            A[i, j] = total
        A[i, i] += damping + 1e-12


@kernel
def _weakest_direction(A: Array, probe: Array, x: Array) -> float:
    """Smallest singular value of J from A = J J^T (6, 6), overwritten, by one inverse iteration; ``x`` (6,)
    is room.

    ``probe`` (6,) is the unit vector of the last iteration, then of this one.
    """
    solve_positive(A, probe, x)
    size = 0.0
    for i in range(6):
        size += x[i] * x[i]
    size = math.sqrt(size)
    for i in range(6):
        probe[i] = x[i] / size
    return 1.0 / math.sqrt(size)


# What the robot does after a guard has tripped: it brakes, goes back along the tool axis, and stands.
#
# The stop reaches the robot by its own line; until then it follows its last request. The retract is the
# robot's own motion, without the controller.

SENT, BRAKING, GOING_BACK, ENDING, STANDING = range(5)
STRAY = 0.005  # so far across the tool axis the retract is given up (singularity, a joint's end) [m]
SHORT = 0.001  # a retract may fall short by this and still be one [m]
_PATIENCE = 2.0  # the retract may take this many times as long as planned


class StopMotion(Record):
    """How the robot stops, and how far it is with that."""

    latency: float  #: From the guard to the brakes [s]
    firmness: float  #: Deceleration as a multiple of speedl's
    clearance: float  #: Length of the retract [m]; 0 for none
    retract_speed: float  #: [m/s]
    stage: int
    time: float  #: In this stage [s]
    braked_at: float  #: When the brakes came on [s]
    height: float  #: Gone back [m]
    origin: Vector3  #: Where the retract began [m]
    axis: Vector3  #: Direction of the retract, against the tool axis


def brakes_of(robot: RobotConfig, safety: SafetyConfig) -> Array:
    """Deceleration of a protective stop [m/s^2], [rad/s^2], shape (2,): speedl's limits, both as much
    firmer."""
    deceleration = safety.stop_deceleration_m_s2
    turning = robot.angular_acceleration_rad_s2 * deceleration / robot.linear_acceleration_m_s2
    return np.array([deceleration, turning])


def build_stop_motion(robot: RobotConfig, safety: SafetyConfig, clearance: float) -> StopMotion:
    """How a robot stops; ``clearance`` [m] is how far it goes back."""
    return StopMotion(
        latency=safety.stop_latency_s,
        firmness=safety.stop_deceleration_m_s2 / robot.linear_acceleration_m_s2,
        clearance=clearance,
        retract_speed=safety.retract_speed_m_s,
    )


@kernel
def steer_stop(
    stop: StopMotion, robot: Speedl, m: Measurement, inside: bool, since_stop: float, t: float, dt: float
) -> float:
    """Move the robot on after the stop: from the brakes on its acting request is written.

    Args:
        stop: How it stops; its state is written.
        robot: The velocity interface.
        m: Tool pose.
        inside: False if a joint was at the end of its range in the last step.
        since_stop: Time since the guard tripped [s].
        t: Time [s].
        dt: Physics step [s].

    Returns:
        Multiple of speedl's acceleration limits that holds for this step.
    """
    stop.time += dt
    if stop.stage == SENT:
        if since_stop < stop.latency - 0.5 * dt:
            return 1.0
        _enter(stop, BRAKING)
        stop.braked_at = t
    elif stop.stage == BRAKING and _at_rest(robot):
        _enter(stop, GOING_BACK if stop.clearance > 0.0 else STANDING)
        for i in range(3):
            stop.origin[i], stop.axis[i] = m.position[i], -m.rotation[i, 2]
    elif stop.stage == GOING_BACK and _back_enough(stop, m, inside):
        _enter(stop, ENDING)
    elif stop.stage == ENDING and _at_rest(robot):
        _enter(stop, STANDING)
    speed = stop.retract_speed if stop.stage == GOING_BACK else 0.0
    robot.age = 0.0
    for i in range(3):
        robot.request[i], robot.request[3 + i] = speed * stop.axis[i], 0.0
    return 1.0 if stop.stage == GOING_BACK else stop.firmness


@kernel
def _enter(stop: StopMotion, stage: int) -> None:
    stop.stage = stage
    stop.time = 0.0


@kernel
def _at_rest(robot: Speedl) -> bool:
    size = 0.0
    for i in range(6):
        size += abs(robot.twist[i])
    return size == 0.0


@kernel
def _back_enough(stop: StopMotion, m: Measurement, inside: bool) -> bool:
    """Whether the retract is done, or cannot continue as it should."""
    gone = minus(m.position, stop.origin)
    stop.height = height = dot(gone, stop.axis)
    late = stop.time > _PATIENCE * stop.clearance / stop.retract_speed + 0.5
    return height >= stop.clearance or dot(gone, gone) - height * height > STRAY**2 or late or not inside
