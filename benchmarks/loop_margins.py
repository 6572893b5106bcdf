"""Margins of a force loop from its frequency response, by the linear model."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.linear_arm import JointsAbout, joints_about
from polish_sim.config import Scenario
from polish_sim.scoring.border import linear_law_of
from polish_sim.scoring.loop_model import (
    FORCE_POSE,
    Complex,
    LinearLaw,
    LoopArm,
    LoopSetup,
    build_plant,
    contour,
    elastic_arm,
    plant_response,
    setup_of,
    turns_about_minus_one,
)
from polish_sim.scoring.measured_law import MeasuredLaw

SWINGS = (0.0, 2e-5, 5e-5, 1e-4, 2e-4)  #: Amplitudes of the gears' twist to linearise at [rad]
NYQUIST = 3141.0  #: Highest frequency a host at 1 kHz can act at [rad/s]
#: Open loop L(j omega) of frequencies (n,) [rad/s]; the closed loop is 1 + L = 0
Response = Callable[[Array], Complex]

Loop = Callable[[Complex], Complex]  #: Open loop L(z), closed by 1 + L = 0


def force_loop(setup: LoopSetup, law: LinearLaw) -> Loop:
    """Open loop L(z) of plant, latencies and law, cut at the command."""
    plant = build_plant(setup)

    def loop(z: Complex) -> Complex:
        reading = plant_response(plant, plant.reading, z) * z ** float(-setup.sensor_steps)
        velocity = plant_response(plant, plant.velocity, z)
        return -(law.by_force(z) * reading + law.by_motion(z) * velocity) * z ** float(-setup.command_steps)

    return loop


class Margins(NamedTuple):
    """How far a stable loop is from its border."""

    gain: float  #: The loop's gain may grow by this factor [-]
    phase: float  #: The loop may lag this much more at any crossover [rad]
    delay: float  #: The loop may be this much later [s]
    crossover: float  #: Highest frequency at which the loop's gain is one [rad/s]; NaN when it never is
    #: Frequency at which it would oscillate if the gain grew [rad/s]; NaN when it never would
    phase_crossover: float


def margins(loop: Response) -> Margins:
    """Gain, phase and delay margin of a stable loop from its open-loop response, 0.1 rad/s to the host's
    Nyquist frequency; infinite without a crossover of that kind.
    """
    omega = np.geomspace(0.1, NYQUIST, 1500)
    response = loop(omega)
    size, phase = np.log(np.abs(response)), np.unwrap(np.angle(response))
    gains, phases, delays = [math.inf], [math.inf], [math.inf]
    crossover = phase_crossover = math.nan
    for k, share in _crossings(size):
        w = float(np.exp(_between(np.log(omega), k, share)))
        over = math.remainder(_between(phase, k, share) + math.pi, 2.0 * math.pi)
        phases.append(abs(over))
        delays.append((over if over >= 0.0 else over + 2.0 * math.pi) / w)
        crossover = w
    turns = (phase + math.pi) / (2.0 * math.pi)
    for whole in range(math.ceil(turns.min()), math.floor(turns.max()) + 1):
        for k, share in _crossings(turns - whole):
            gain = math.exp(-_between(size, k, share))
            if 1.0 < gain < min(gains):
                phase_crossover = float(np.exp(_between(np.log(omega), k, share)))
            if gain > 1.0:
                gains.append(gain)
    return Margins(min(gains), min(phases), min(delays), crossover, phase_crossover)


def _crossings(values: Array) -> list[tuple[int, float]]:
    """Rows before a change of sign and the share of the way to the next row at which it happens."""
    rows = np.flatnonzero(np.diff(np.signbit(values)))
    return [(int(k), float(values[k] / (values[k] - values[k + 1]))) for k in rows]


def _between(values: Array, k: int, share: float) -> float:
    return float(values[k] + share * (values[k + 1] - values[k]))


def response_of(loop: Loop, dt: float) -> Response:
    """A loop over frequency [rad/s], as ``margins`` wants it."""
    return lambda omega: loop(np.exp(1j * omega * dt))


_ABOUT = 2.0 * math.pi * 20.0  # where the damping of the hysteresis is matched [rad/s]


def swinging_arm(about: JointsAbout, swing: float) -> LoopArm:
    """The arm about a pose with the hysteresis of its gears at an amplitude ``swing`` of their twist [rad]: a
    part of its torque is elastic, a part damps (by harmonic balance, about 20 Hz)."""
    arm, lost, rise = elastic_arm(about), np.array(about.arm.lost_torque), about.arm.rise
    if swing == 0.0:
        return arm
    phase = np.linspace(0.0, 2.0 * math.pi, 401)
    twist, torque, torques = swing * np.cos(phase), np.zeros(6), np.empty((400, 6))
    for _ in range(3):
        for k, moved in enumerate(np.diff(twist)):
            most = np.copysign(lost, moved)
            torques[k] = torque = most + (torque - most) * math.exp(-abs(moved) / rise)  # as `gears.slip`
    slipping = 2.0 * np.exp(-1j * phase[1:]) @ torques / (400.0 * swing)
    between = np.array([[1.0, -1.0], [-1.0, 1.0]])
    return arm._replace(
        stiffness=arm.stiffness + np.kron(between, np.diag(slipping.real - lost / rise)),
        damping=arm.damping + np.kron(between, np.diag(slipping.imag / _ABOUT)),
    )


def linear_loop(scenario: Scenario, swing: float = 0.0, law: MeasuredLaw | None = None) -> Loop:
    """Open loop L(z) of a scenario, the ``law`` settled on its springs; elastic gears swing by ``swing``
    [rad]."""
    elastic = scenario.robot.elastic
    arm = swinging_arm(joints_about(scenario, FORCE_POSE[None])[0], swing) if elastic else None
    setup = setup_of(scenario, arm)
    return force_loop(setup, law or linear_law_of(scenario, scenario.head.spring_scale))


def analytic_margins(scenario: Scenario, law: MeasuredLaw | None = None) -> Margins:
    """Margins of a scenario's force loop by the linear model, the ``law`` settled on the scenario's springs.

    Of elastic joints the least at any of the `SWINGS`; all zero where the loop is unstable at one.
    """
    dt, found = scenario.simulation.timestep_s, []
    law = law or linear_law_of(scenario, scenario.head.spring_scale)
    for swing in SWINGS if scenario.robot.elastic else SWINGS[:1]:
        loop = linear_loop(scenario, swing, law)
        if turns_about_minus_one(loop(contour(dt))) > 0:
            return Margins(0.0, 0.0, 0.0, math.nan, math.nan)
        found.append(margins(response_of(loop, dt)))
    least = min(found, key=lambda m: m.gain)
    return least._replace(phase=min(m.phase for m in found), delay=min(m.delay for m in found))
