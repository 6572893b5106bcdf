"""Measurements and targets for the laws; plants in closed form: late commands, a late sensor, a spring."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.config import ControllerConfig
from polish_sim.control import CONTROLLERS, Course
from polish_sim.control.signals import CompiledController, Measurement, Target

DT = 0.001
CONFIG = ControllerConfig()


def controller(name: str, config: ControllerConfig = CONFIG) -> CompiledController:
    made = CONTROLLERS[name](config)
    made.reset(DT)
    return made


def measurement_at_rest() -> Measurement:
    """A tool at rest at the origin, z along base z."""
    m = Measurement()
    m.rotation[:] = np.eye(3)
    m.cycle = DT
    return m


def target_to_press(force: float = 20.0, contact: float = 0.0) -> Target:
    t = Target()
    t.rotation[:] = np.eye(3)
    t.force, t.contact = force, contact
    return t


def measurement_from(rng: np.random.Generator) -> Measurement:
    """A random measurement of a tool near some pose, moving and pressing."""
    m = Measurement()
    m.position[:] = rng.normal(size=3)
    m.rotation[:] = Rotation.random(random_state=rng).as_matrix()
    m.twist[:] = 0.1 * rng.normal(size=6)
    m.wrench[:] = [3.0, -2.0, 15.0, 0.1, -0.2, 0.05] * rng.normal(size=6)
    m.time, m.cycle = 0.0, DT
    return m


def target_near(m: Measurement, rng: np.random.Generator, contact: float) -> Target:
    """A target a few millimetres and degrees away from a measurement."""
    t = Target()
    t.position[:] = m.position + 0.003 * rng.normal(size=3)
    t.rotation[:] = Rotation.from_rotvec(0.02 * rng.normal(size=3)).as_matrix() @ m.rotation
    t.twist[:] = 0.05 * rng.normal(size=6)
    t.force, t.moment = 20.0, 0.0
    t.contact = contact
    return t


ACCELERATION, GAP = 1.2, 0.008  # [m/s^2], and from the tool to the part at first [m]
SPACING, SPRING, FORCE, FEED = 0.0005, 5000.0, 20.0, 0.06  # [m], [N/m], [N], [m/s]


class Plant(NamedTuple):
    """What the controller does not know."""

    stiffness: float = 5000.0  #: [N/m]
    command_delay: int = 8  #: [cycles]
    sensor_delay: int = 2  #: [cycles]
    noise: float = 0.0  #: White, before the sensor's low-pass, rms [N]
    mass: float = 2.0  #: Carried by the sensor [kg]
    rise: float = 0.0  #: Speed of the part towards the tool after 0.6 s [m/s]


class Run(NamedTuple):
    time: Array
    force: Array


class Tool:
    """Late commands, the tool an integrator of limited acceleration, a late sensor behind its low-pass."""

    def __init__(self, plant: Plant, z: float = 0.0) -> None:
        self.z, self.v, self.sensed, self.mass = z, 0.0, 0.0, plant.mass
        delays = plant.command_delay, plant.sensor_delay
        self.commands, self.readings = (deque([0.0] * (n + 1)) for n in delays)

    def step(self, command: float, force: float) -> None:
        """Move on under a command [m/s]; ``force`` on the sensor but for what it carries [N]."""
        self.commands.append(command)
        change = min(max(self.commands.popleft() - self.v, -ACCELERATION * DT), ACCELERATION * DT)
        self.v += change
        self.z += self.v * DT
        blend = 1.0 - math.exp(-2.0 * math.pi * 80.0 * DT)
        self.sensed += blend * (force + self.mass * change / DT - self.sensed)
        self.readings.append(self.sensed)


def land(controller: CompiledController, plant: Plant, approach=0.02, seconds=1.5, set_force=20.0) -> Run:
    """Come down on the spring at ``approach`` [m/s]; the target's contact begins when 2 N are measured."""
    rng, tool, planned, forces = np.random.default_rng(0), Tool(plant), 0.0, []
    controller.reset(DT)
    m, t = measurement_at_rest(), target_to_press(set_force)
    while len(forces) < seconds / DT:
        part = GAP - plant.rise * max(0.0, len(forces) * DT - 0.6)
        force = plant.stiffness * max(tool.z - part, 0.0)
        if force > 0.5 or forces:
            forces.append(force)
        m.position[2], m.twist[2], m.wrench[2] = tool.z, tool.v, tool.readings.popleft()
        if m.wrench[2] > max(2.0, 2.7 * plant.noise):
            t.contact = True
        planned = 0.0 if t.contact else min(planned + 0.05 * DT, approach)
        t.twist[2] = planned
        t.position[2] = tool.z if t.contact else t.position[2] + planned * DT
        tool.step(float(controller.step(m, t)[2]), force + plant.noise * float(rng.standard_normal()))
        m.time += DT
    return Run(DT * np.arange(len(forces)), np.array(forces))


def settling(run: Run, wanted: float, band: float = 1.0) -> float:
    """Time after which the force stays within a band [s]."""
    outside = np.flatnonzero(np.abs(run.force - wanted) > band)
    return float(run.time[min(outside[-1] + 1, len(run.time) - 1)])


def course_of(surplus: Array, neighbour: Array | None = None, feed: float = FEED) -> Course:
    """A straight path on a flat part that asks for this surplus depth [m], rows (n,)."""
    n = len(surplus)
    zero = np.zeros(n)
    beside = np.full(n, -1) if neighbour is None else neighbour.astype(np.int64)
    return Course(
        SPACING, FORCE / SPRING + surplus, surplus, zero + SPRING, np.zeros((n, 2)), np.full((n, 2), 3.125),
        zero, zero, np.zeros((n, 3)), zero + feed, beside, zero,
    )  # fmt: skip


def follow(controller: CompiledController, depth, length: float) -> tuple[Array, Array]:
    """Land, then feed along a track ``depth(s)`` [m] deeper than flat; places [m] and force errors [N]."""
    tool, m, t = Tool(Plant(), z=-0.002), measurement_at_rest(), target_to_press(FORCE)
    controller.reset(DT)
    s, clock, places, errors = 0.0, 0.0, [], []
    while s < length:
        force = SPRING * max(tool.z - depth(s), 0.0)
        m.position[:], m.twist[2], m.time = (s, 0.0, tool.z), tool.v, clock
        m.wrench[2] = tool.readings.popleft()
        if m.wrench[2] > 2.0:
            t.contact = True
        t.s, t.speed = s, FEED if clock > 1.0 else 0.0
        t.twist[0], t.twist[2] = t.speed, 0.0 if t.contact else 0.01
        t.position[:] = s, 0.0, FORCE / SPRING
        answer = controller.step(m, t)
        tool.step(float(answer[2]), force)
        if clock > 1.0:
            places.append(s)
            errors.append(FORCE - force)
            s += FEED * float(answer[6]) * DT
        clock += DT
    return np.array(places), np.array(errors)
