"""What the robot does after a guard has tripped: it brakes, goes back along the tool axis, and stands.

The stop reaches the robot by its own line; until then it follows its last request. The retract is the robot's own
motion, without the controller.
"""

from __future__ import annotations

import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.speedl import Speedl
from polish_sim.config import Scenario
from polish_sim.control.signals import Measurement
from polish_sim.kernels import Record, Vector3, kernel

SENT, BRAKING, GOING_BACK, ENDING, STANDING = range(5)
STRAY = 0.005  # so far across the tool axis the retract is given up (singularity, a joint's end) [m]
SHORT = 0.001  # a retract may fall short by this and still be one [m]
_PATIENCE = 2.0  # the retract may take this many times as long as planned


class StopMotion(Record):
    """How the robot stops, and how far it is with that."""

    latency: float
    """From the guard to the brakes [s]."""
    firmness: float
    """Deceleration as a multiple of speedl's."""
    clearance: float
    """Length of the retract [m]; 0 for none."""
    retract_speed: float
    """[m/s]"""
    stage: int
    time: float
    """In this stage [s]."""
    braked_at: float
    """When the brakes came on [s]."""
    height: float
    """Gone back [m]."""
    origin: Vector3
    """Where the retract began [m]."""
    axis: Vector3
    """Direction of the retract, against the tool axis."""


def brakes_of(scenario: Scenario) -> Array:
    """Deceleration of a protective stop [m/s^2], [rad/s^2], shape (2,): speedl's limits, both as much firmer."""
    robot, deceleration = scenario.robot, scenario.safety.stop_deceleration_m_s2
    turning = robot.angular_acceleration_rad_s2 * deceleration / robot.linear_acceleration_m_s2
    return np.array([deceleration, turning])


def build_stop_motion(scenario: Scenario, clearance: float) -> StopMotion:
    """How this scenario's robot stops; ``clearance`` [m] is how far it goes back."""
    safety = scenario.safety
    firmness = safety.stop_deceleration_m_s2 / scenario.robot.linear_acceleration_m_s2
    return StopMotion(
        latency=safety.stop_latency_s, firmness=firmness, clearance=clearance, retract_speed=safety.retract_speed_m_s
    )


@kernel
def steer_stop(
    stop: StopMotion, robot: Speedl, m: Measurement, inside: bool, since_stop: float, t: float, dt: float
) -> float:
    """Move the robot on after the stop.

    Args:
        stop: How it stops; its state is written.
        robot: The velocity interface; from the brakes on its acting request is written.
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
    stop.stage, stop.time = stage, 0.0


@kernel
def _at_rest(robot: Speedl) -> bool:
    size = 0.0
    for i in range(6):
        size += abs(robot.twist[i])
    return size == 0.0


@kernel
def _back_enough(stop: StopMotion, m: Measurement, inside: bool) -> bool:
    """Whether the retract is done, or cannot go on as it should."""
    height = away = 0.0
    for i in range(3):
        gone = m.position[i] - stop.origin[i]
        height += gone * stop.axis[i]
        away += gone * gone
    stop.height = height
    late = stop.time > _PATIENCE * stop.clearance / stop.retract_speed + 0.5
    return height >= stop.clearance or away - height * height > STRAY**2 or late or not inside
