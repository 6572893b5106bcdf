"""Plants in closed form: late commands, the tool an integrator, a late and noisy sensor, and a spring whose
ground is at rest, rises evenly, or rises and falls along a track the tool is fed on."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.control import Course
from polish_sim.control.signals import CompiledController
from tests.control.signals import DT, measurement_at_rest, target_to_press

ACCELERATION, GAP = 1.2, 0.008  # [m/s^2], and from the tool to the part at first [m]


class Plant(NamedTuple):
    """What the controller does not know."""

    stiffness: float = 5000.0  #: [N/m]
    command_delay: int = 8  #: [cycles]
    sensor_delay: int = 2  #: [cycles]
    noise: float = 0.0  #: White, before the sensor's low-pass, rms [N]
    mass: float = 2.0  #: Carried by the sensor [kg]
    rise: float = 0.0  #: Speed of the part towards the tool after 0.6 s [m/s]


class Run(NamedTuple):
    """Time from first contact on, and the exact force."""

    time: Array
    force: Array


def land(controller: CompiledController, plant: Plant, approach=0.02, seconds=1.5, set_force=20.0) -> Run:
    """Come down on the spring at ``approach`` [m/s]; the target's contact begins when 2 N are measured."""
    rng, blend = np.random.default_rng(0), 1.0 - math.exp(-2.0 * math.pi * 80.0 * DT)
    controller.reset(DT)
    m, t = measurement_at_rest(), target_to_press(set_force)
    commands, readings = deque([0.0] * (plant.command_delay + 1)), deque([0.0] * (plant.sensor_delay + 1))
    z = v = sensed = planned = 0.0
    forces: list[float] = []
    while len(forces) < seconds / DT:
        part = GAP - plant.rise * max(0.0, len(forces) * DT - 0.6)
        force = plant.stiffness * max(z - part, 0.0)
        if force > 0.5 or forces:
            forces.append(force)
        m.position[2], m.twist[2], m.wrench[2] = z, v, readings.popleft()
        if m.wrench[2] > max(2.0, 2.7 * plant.noise):
            t.contact = True
        planned = 0.0 if t.contact else min(planned + 0.05 * DT, approach)
        t.twist[2] = planned
        t.position[2] = z if t.contact else t.position[2] + planned * DT
        commands.append(float(controller.step(m, t)[2]))
        step = ACCELERATION * DT
        before, v = v, v + min(max(commands.popleft() - v, -step), step)
        z += v * DT
        load = force + plant.mass * (v - before) / DT + plant.noise * float(rng.standard_normal())
        sensed += blend * (load - sensed)
        readings.append(sensed)
        m.time += DT
    return Run(DT * np.arange(len(forces)), np.array(forces))


def settling(run: Run, wanted: float, band: float = 1.0) -> float:
    """Time after which the force stays within a band [s]."""
    outside = np.flatnonzero(np.abs(run.force - wanted) > band)
    return float(run.time[min(outside[-1] + 1, len(run.time) - 1)])


SPACING = 0.0005
SPRING = 5000.0
FORCE = 20.0
FEED = 0.06


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
    blend = 1.0 - math.exp(-2.0 * math.pi * 80.0 * DT)
    feed, m, t = FEED, measurement_at_rest(), target_to_press(FORCE)
    controller.reset(DT)
    commands, readings = deque([0.0] * 9), deque([0.0] * 3)
    z, v, sensed, s, clock, approach = -0.002, 0.0, 0.0, 0.0, 0.0, 0.01
    places, errors = [], []
    while s < length:
        force = SPRING * max(z - depth(s), 0.0)
        m.position[:], m.twist[2], m.wrench[2], m.time = (s, 0.0, z), v, readings.popleft(), clock
        if m.wrench[2] > 2.0:
            t.contact = True
        fed = clock > 1.0
        t.s, t.speed, t.twist[0] = s, feed if fed else 0.0, feed if fed else 0.0
        t.twist[2] = 0.0 if t.contact else approach
        t.position[:] = s, 0.0, FORCE / SPRING
        answer = controller.step(m, t)
        commands.append(float(answer[2]))
        before, v = v, v + min(max(commands.popleft() - v, -1.2 * DT), 1.2 * DT)
        z += v * DT
        sensed += blend * (force + 2.0 * (v - before) / DT - sensed)
        readings.append(sensed)
        if fed:
            places.append(s)
            errors.append(FORCE - force)
            s += feed * float(answer[6]) * DT
        clock += DT
    return np.array(places), np.array(errors)
