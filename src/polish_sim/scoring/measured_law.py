"""A control law of the force loop made linear by asking it: any controller, the shipped ones and a user's.

The law is let down onto the modelled plant until it presses steadily, so that what it estimates has settled.
Then its inputs are frozen and one of them is nudged for a single cycle; how the answer differs from the
unnudged one is its impulse response.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.control.signals import (
    Controller,
    Course,
    Measurement,
    Target,
)
from polish_sim.scoring.loop_model import Complex, LoopSetup, Plant, build_plant

START = -0.002  # of the pad below the surface [m]
APPROACH = 0.004  # [m/s]
TOUCHING = 2.0  # reading that counts as contact [N]
RAMP_S = 0.35  # time in which the target goes down to its depth
PRESSED_S = 2.5  # time the law has to settle
RESPONSE_S = 3.0  # length of the impulse responses
SETTLED = 0.05  # share of the force, and of the springs' way in a second, that a settled law may be off
NUDGE_N, NUDGE_M_S = 1e-3, 1e-6
AXIS = -1.0  # tool z points down in the base frame


class MeasuredLaw(NamedTuple):
    """Changes of the answer from step to step after a nudge of one cycle; they must have died away at the
    end."""

    force: Array  #: Of the reading [m/(s N)], shape (n,)
    motion: Array  #: Of the tool's velocity [-], shape (n,)
    #: Whether the law pressed steadily with the wanted force before the nudge; else it is not its law
    settled: bool

    def by_force(self, z: Complex) -> Complex:
        """Response to the force reading [m/(s N)]."""
        return _sum_up(self.force, z)

    def by_motion(self, z: Complex) -> Complex:
        """Response to the tool's velocity, its place moving with it [-]."""
        return _sum_up(self.motion, z)


def measure_law(
    controller: Controller, setup: LoopSetup, force: float, nominal_stiffness: float
) -> MeasuredLaw:
    """Impulse responses of a controller, which is reset, about steady pressing with a force [N] on a plant.

    ``nominal_stiffness``: what the plan takes head and pad for, in series [N/m].
    """
    kernels = []
    at_rest, reading = _answers(controller, setup, force, nominal_stiffness, 0.0, 0.0)
    for nudge_n, nudge_m_s in ((NUDGE_N, 0.0), (0.0, NUDGE_M_S)):
        nudged, _ = _answers(controller, setup, force, nominal_stiffness, nudge_n, nudge_m_s)
        kernels.append(np.diff(nudged - at_rest, prepend=0.0) / (nudge_n + nudge_m_s))
    settled = (
        abs(reading - force) < SETTLED * force and abs(float(at_rest[0])) < SETTLED * force / setup.stiffness
    )
    return MeasuredLaw(kernels[0], kernels[1], settled)


def flat_course(force: float, stiffness: float) -> Course:
    """What lies ahead of a tool that holds one point of a plane with a force [N] on springs [N/m]."""
    rows = np.zeros(3)
    return Course(
        0.001, rows + force / stiffness, rows, rows + stiffness, np.zeros((3, 2)), np.zeros((3, 2)), rows,
        rows, np.zeros((3, 3)), rows + 0.01, np.full(3, -1), rows,
    )  # fmt: skip


def _answers(
    controller: Controller, setup: LoopSetup, force: float, stiffness: float, nudge_n: float, nudge_m_s: float
) -> tuple[Array, float]:
    """Speeds along the tool axis asked for after a nudge [m/s], inputs frozen, shape (n,), and the frozen
    reading."""
    stand = _Stand(setup, force, stiffness)
    prepare = getattr(controller, "prepare", None)
    if callable(prepare):
        prepare(flat_course(force, stiffness))
    controller.reset(setup.dt)
    while stand.pressed < PRESSED_S:
        stand.press_on(_along(controller.step(stand.measurement, stand.target)))
    stand.freeze()
    answers = np.empty(round(RESPONSE_S / setup.dt))
    for k in range(len(answers)):
        stand.show(nudge_n if k == 0 else 0.0, nudge_m_s if k == 0 else 0.0, nudge_m_s * setup.dt)
        answers[k] = _along(controller.step(stand.measurement, stand.target))
    return answers, float(stand.shown[0])


def _along(answer: Array) -> float:
    return AXIS * float(answer[2])


def _sum_up(kernel: Array, z: Complex) -> Complex:
    """Transfer of a law whose answer's changes after an impulse are ``kernel``: sum kernel_n z^-n / (1 -
    1/z)."""
    return np.polyval(kernel[::-1], 1.0 / z) / (1.0 - 1.0 / z)


class _Stand:
    """The modelled plant with contact made and lost, and what the host reads of it."""

    def __init__(self, setup: LoopSetup, force: float, stiffness: float) -> None:
        self.setup = setup
        self.touching: Plant = build_plant(setup)
        self.free: Plant = build_plant(setup._replace(pad_stiffness=0.0, pad_damping=0.0))
        self.state = START * self.touching.moved
        self.samples, self.commands = np.zeros(setup.sensor_steps + 1), np.zeros(setup.command_steps + 1)
        self.depth, self.goal, self.speed = START, force / stiffness, APPROACH
        self.pressed, self.time = 0.0, 0.0
        self.measurement: Measurement = Measurement()
        self.target: Target = Target()
        self.measurement.rotation[:] = self.target.rotation[:] = np.diag([1.0, -1.0, -1.0])
        self.measurement.cycle, self.target.force = setup.dt, force
        self.shown = np.zeros(3)
        self._show(*self._read())

    def press_on(self, command: float) -> None:
        """Take a command and advance by one step."""
        self.commands = np.concatenate([[command], self.commands[:-1]])
        plant = self._plant()
        self.state = plant.A @ self.state + plant.B * self.commands[-1]
        self.samples = np.concatenate([[self._plant().reading @ self.state], self.samples[:-1]])
        touching = self.target.contact
        if touching:
            self.pressed += self.setup.dt
            left = max(RAMP_S - self.pressed, self.setup.dt)
            self.speed = (self.goal - self.depth) / left if self.pressed < RAMP_S else 0.0
        elif self.samples[-1] > TOUCHING:
            self.target.contact = True
        self.depth += self.speed * self.setup.dt
        self._show(*self._read())

    def freeze(self) -> None:
        """Keep what the host reads now."""
        self.shown = np.array(self._read())
        self.shown[1] = 0.0

    def show(self, force: float, velocity: float, place: float) -> None:
        """Let the host read the frozen values and a nudge on them."""
        self._show(self.shown[0] + force, self.shown[1] + velocity, self.shown[2] + place)

    def _plant(self) -> Plant:
        return self.touching if self.touching.head @ self.state > 0.0 else self.free

    def _read(self) -> tuple[float, float, float]:
        plant = self.touching
        return float(self.samples[-1]), float(plant.velocity @ self.state), float(plant.position @ self.state)

    def _show(self, reading: float, velocity: float, place: float) -> None:
        m, t = self.measurement, self.target
        self.time += self.setup.dt
        m.time = self.time
        m.wrench[2], m.twist[2], m.position[2] = reading, AXIS * velocity, AXIS * place
        t.position[2], t.twist[2] = AXIS * self.depth, AXIS * self.speed
