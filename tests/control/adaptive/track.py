"""A wavy track in closed form: the tool is fed along x and presses on a spring whose ground rises and
falls."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np

from polish_sim.arrays import Array
from polish_sim.control import Course
from polish_sim.control.signals import CompiledController
from tests.control.signals import DT, measurement_at_rest, target_to_press

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


def follow(
    controller: CompiledController, depth: Callable[[float], float], length: float
) -> tuple[Array, Array]:
    """Land, then feed along a track that lies ``depth(s)`` [m] deeper than flat; places [m] and force errors
    [N]."""
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
