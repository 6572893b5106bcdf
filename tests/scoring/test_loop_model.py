"""The linear force loop against closed forms, eigenvalues, the compiled laws and the cell."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from benchmarks.force_theory import noise_rms, surface_error
from benchmarks.loop_margins import Response, margins
from polish_sim.arrays import Array
from polish_sim.control import Measurement, Target, build_controller
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.scoring import loop_model
from polish_sim.scoring.measured_law import measure_law

FORCE = override(default_scenario("force"), ["robot.arm=ideal"])


class PiLaw(NamedTuple):
    """State space of a filtered PI law on the force reading r: s' = A s + B r, speed = C s + D r."""

    A: Array  #: Shape (n, n)
    B: Array  #: Shape (n,)
    C: Array  #: Shape (n,)
    D: float

    def by_force(self, z: loop_model.Complex) -> loop_model.Complex:
        systems = z[:, None, None] * np.eye(len(self.B)) - self.A
        states = np.linalg.solve(systems, np.broadcast_to(self.B[:, None], (len(z), len(self.B), 1)))
        return states[:, :, 0] @ self.C + self.D

    def by_motion(self, z: loop_model.Complex) -> loop_model.Complex:
        return np.zeros_like(z)


def pi_law(p: float, i: float, filter_hz: float, dt: float) -> PiLaw:
    """The law of ``control.loops.force_pi`` within its limits; states: the filtered reading and its sum over
    time.

    ``p`` [m/(s N)], ``i`` [m/(s^2 N)], the low-pass' corner [Hz], the control cycle [s].
    """
    blend = 1.0 - math.exp(-2.0 * math.pi * filter_hz * dt)
    A = np.array([[1.0 - blend, 0.0], [dt * (1.0 - blend), 1.0]])
    B = np.array([blend, dt * blend])
    C = np.array([-p, -i])
    return PiLaw(A, B, C @ A, float(C @ B))


def closed_loop_matrix(setup: loop_model.LoopSetup, law: PiLaw) -> Array:
    """One step of the closed loop, its eigenvalues the poles: plant, law, samples and commands under way."""
    plant = loop_model.build_plant(setup)
    n, m, late, far = len(plant.B), len(law.B), setup.sensor_steps, setup.command_steps
    size = n + m + late + far
    laws, samples, commands = n, n + m, n + m + late
    read = np.zeros(size)
    if late:
        read[samples + late - 1] = 1.0
    else:
        read[:n] = plant.reading
    answer = law.D * read
    answer[laws:samples] += law.C
    acting = answer
    if far:
        acting = np.zeros(size)
        acting[commands + far - 1] = 1.0
    step = np.zeros((size, size))
    step[:n, :n] = plant.A
    step[:n] += np.outer(plant.B, acting)
    step[laws:samples, laws:samples] = law.A
    step[laws:samples] += np.outer(law.B, read)
    if late:
        step[samples, :n] = plant.reading
        step[samples + 1 : commands, samples : commands - 1] = np.eye(late - 1)
    if far:
        step[commands] = answer
        step[commands + 1 :, commands:-1] = np.eye(far - 1)
    return step


def growth(matrix: Array, dt: float) -> float:
    return math.log(max(float(np.abs(np.linalg.eigvals(matrix)).max()), 1e-12)) / dt


def _loop(*changes: str) -> tuple[loop_model.LoopSetup, PiLaw]:
    """The force loop of ``hybrid-pi`` (paper 1, eq. 5 behind a low-pass)."""
    scenario = override(FORCE, list(changes))
    setup, gains = loop_model.setup_of(scenario), scenario.controller
    return setup, pi_law(gains.force_p_m_sn, gains.force_i_m_s2n, gains.force_filter_hz, setup.dt)


def test_slow_motion_presses_the_springs_in_series_and_servos_swing_over_at_25_hz():
    setup, _ = _loop()
    plant, slow = loop_model.build_plant(setup), np.exp(np.array([0.5j]) * setup.dt)
    pressed = loop_model.plant_response(plant, plant.force, slow) / loop_model.plant_response(
        plant, plant.position, slow
    )
    assert abs(pressed[0]) == pytest.approx(5000.0, rel=1e-3)
    plant = loop_model.build_plant(setup._replace(pad_stiffness=0.0, pad_damping=0.0))
    speed = np.abs(
        loop_model.plant_response(
            plant, plant.velocity, np.exp(2j * math.pi * np.array([0.1, 25.0, 140.0]) * setup.dt)
        )
    )
    assert speed[0] == pytest.approx(1.0, abs=1e-3)
    assert 1.15 < speed[1] < 1.3
    assert speed[2] < 0.5


def forces(setup: loop_model.LoopSetup, law: PiLaw, noise: Array) -> Array:
    """Contact force of the closed loop in time [N], shape (n,), with noise in the sensor [N], shape (n,)."""
    plant, q, noisy = loop_model.build_plant(setup), np.zeros(2), 0.0
    s, found = np.zeros(len(plant.B)), np.empty(len(noise))
    samples, commands = [0.0] * (setup.sensor_steps + 1), [0.0] * (setup.command_steps + 1)
    for k, draw in enumerate(noise):
        noisy += setup.sensor_blend * (draw - noisy)
        samples = [plant.reading @ s + noisy, *samples[:-1]]
        speed = law.C @ q + law.D * samples[-1]
        q = law.A @ q + law.B * samples[-1]
        commands = [speed, *commands[:-1]]
        found[k] = plant.force @ s
        s = plant.A @ s + plant.B * commands[-1]
    return found


def test_noise_has_the_rms_of_a_run_and_only_quick_waves_pass_to_the_springs():
    setup, law = _loop()
    found = forces(setup, law, np.random.default_rng(0).normal(0.0, 0.5, 60_000))
    assert noise_rms(setup, law, 0.5) == pytest.approx(np.std(found[5000:]), rel=0.08)
    error = np.abs(surface_error(setup, law)(np.array([0.1, 100.0])))
    assert error[0] < 0.01 * 5000.0
    assert error[1] > 0.9 * 5000.0


def integrator(crossover: float, delay: float) -> Response:
    """Open loop of a proportional law that presses a spring by velocity: L = p k / s e^(-s delay)."""
    return lambda omega: crossover / (1j * omega) * np.exp(-1j * omega * delay)


@pytest.mark.parametrize(("crossover", "delay"), [(5.0, 0.02), (60.0, 0.004)])
def test_integrator_with_delay_has_the_margins_of_the_textbook(crossover, delay):
    found = margins(integrator(crossover, delay))
    assert found.crossover == pytest.approx(crossover, rel=1e-4)
    assert found.gain == pytest.approx(0.5 * math.pi / (crossover * delay), rel=1e-4)
    assert found.phase == pytest.approx(0.5 * math.pi - crossover * delay, abs=1e-4)
    assert found.delay == pytest.approx(found.phase / crossover, rel=1e-4)
    assert found.phase_crossover == pytest.approx(0.5 * math.pi / delay, rel=1e-3)
    assert margins(integrator(crossover, 0.0)).gain == math.inf


Z = np.exp(1j * np.geomspace(0.5, 3000.0, 9) * 1e-3)


class PressByPlace:
    """No force at all: takes the tool's place back to its target in 0.1 s."""

    def reset(self, cycle_s: float) -> None:
        pass

    def step(self, measurement: Measurement, target: Target) -> np.ndarray:
        return np.concatenate([10.0 * (target.position - measurement.position), np.zeros(3)])


def test_measured_hybrid_pi_is_its_formula():
    setup, formula = _loop()
    law = measure_law(build_controller(FORCE.controller), setup, 20.0, 5000.0)
    assert law.by_force(Z) == pytest.approx(formula.by_force(Z), rel=1e-6)
    assert np.abs(law.by_motion(Z)).max() < 1e-9


def test_a_law_on_the_place_answers_to_motion_only():
    law = measure_law(PressByPlace(), loop_model.setup_of(FORCE), 20.0, 5000.0)
    assert np.abs(law.by_force(Z)).max() < 1e-12
    assert law.by_motion(Z) == pytest.approx(-10.0 * 1e-3 / (1.0 - 1.0 / Z), rel=1e-6)  # the sum of velocity


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_longest_latency_is_where_the_eigenvalues_say(scale):
    drawn, law = _loop()
    setup = loop_model.with_springs(drawn, scale)
    totals = [0.001 * n for n in range(1, 200)]
    longest = loop_model.longest_latency(setup, law, totals)

    def grows(total: float) -> float:
        return growth(
            closed_loop_matrix(loop_model.with_latency(setup, loop_model.share_latency(total)), law), 0.001
        )

    assert grows(longest) <= loop_model.SLOWEST < grows(longest + 0.001)
    assert loop_model.longest_latency(setup, law, totals[:3]) == math.inf
