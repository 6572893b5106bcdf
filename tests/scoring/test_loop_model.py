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


def closed_loop(setup: loop_model.LoopSetup, law: PiLaw) -> tuple[Array, Array]:
    """One step of the closed loop as a matrix, its eigenvalues the poles, and what noise of the reading adds.

    The state: plant, law, samples and commands under way, the newest first.
    """
    plant = loop_model.build_plant(setup)
    sizes = len(plant.B), len(law.B), setup.sensor_steps, setup.command_steps

    def step(state: Array, noise: float = 0.0) -> Array:
        s, q, samples, commands = np.split(state, np.cumsum(sizes)[:-1])
        samples = np.append(plant.reading @ s + noise, samples)
        commands = np.append(law.C @ q + law.D * samples[-1], commands)
        s, q = plant.A @ s + plant.B * commands[-1], law.A @ q + law.B * samples[-1]
        return np.concatenate([s, q, samples[:-1], commands[:-1]])

    units = np.eye(sum(sizes))
    return np.column_stack([step(unit) for unit in units]), step(0.0 * units[0], 1.0)


def _loop() -> tuple[loop_model.LoopSetup, PiLaw]:
    """The force loop of ``hybrid-pi`` (paper 1, eq. 5 behind a low-pass) within its limits; the law's states
    are the filtered reading and its sum."""
    setup, gains = loop_model.setup_of(FORCE), FORCE.controller
    blend = 1.0 - math.exp(-2.0 * math.pi * gains.force_filter_hz * setup.dt)
    A = np.array([[1.0 - blend, 0.0], [setup.dt * (1.0 - blend), 1.0]])
    B, C = np.array([blend, setup.dt * blend]), -np.array([gains.force_p_m_sn, gains.force_i_m_s2n])
    return setup, PiLaw(A, B, C @ A, float(C @ B))


def test_slow_motion_presses_springs_in_series_servos_swing_over_at_25_hz_and_noise_has_its_rms():
    setup, _ = _loop()
    plant, slow = loop_model.build_plant(setup), np.exp(np.array([0.5j]) * setup.dt)
    force, way = (loop_model.plant_response(plant, row, slow)[0] for row in (plant.force, plant.position))
    assert abs(force / way) == pytest.approx(5000.0, rel=1e-3)
    plant = loop_model.build_plant(setup._replace(pad_stiffness=0.0, pad_damping=0.0))
    waves = np.exp(2j * math.pi * np.array([0.1, 25.0, 140.0]) * setup.dt)
    speed = np.abs(loop_model.plant_response(plant, plant.velocity, waves))
    assert speed[0] == pytest.approx(1.0, abs=1e-3)
    assert 1.15 < speed[1] < 1.3
    assert speed[2] < 0.5
    # Only quick waves pass to the springs.
    setup, law = _loop()
    found = forces(setup, law, np.random.default_rng(0).normal(0.0, 0.5, 60_000))
    assert noise_rms(setup, law, 0.5) == pytest.approx(np.std(found[5000:]), rel=0.08)
    error = np.abs(surface_error(setup, law)(np.array([0.1, 100.0])))
    assert error[0] < 0.01 * 5000.0
    assert error[1] > 0.9 * 5000.0


def forces(setup: loop_model.LoopSetup, law: PiLaw, noise: Array) -> Array:
    """Contact force of the closed loop in time [N], shape (n,), with noise in the sensor [N], shape (n,)."""
    (step, entry), plant = closed_loop(setup, law), loop_model.build_plant(setup)
    state, noisy, found = 0.0 * entry, 0.0, np.empty(len(noise))
    for k, draw in enumerate(noise):
        noisy += setup.sensor_blend * (draw - noisy)
        found[k] = plant.force @ state[: len(plant.B)]
        state = step @ state + entry * noisy
    return found


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


class PressByPlace:
    """No force at all: takes the tool's place back to its target in 0.1 s."""

    def reset(self, cycle_s: float) -> None:
        pass

    def step(self, measurement: Measurement, target: Target) -> np.ndarray:
        return np.concatenate([10.0 * (target.position - measurement.position), np.zeros(3)])


def test_a_measured_law_is_its_formula_and_one_on_the_place_answers_to_motion_only():
    (setup, formula), z = _loop(), np.exp(1j * np.geomspace(0.5, 3000.0, 9) * 1e-3)
    law = measure_law(build_controller(FORCE.controller), setup, 20.0, 5000.0)
    assert law.by_force(z) == pytest.approx(formula.by_force(z), rel=1e-6)
    assert np.abs(law.by_motion(z)).max() < 1e-9
    law = measure_law(PressByPlace(), setup, 20.0, 5000.0)
    assert np.abs(law.by_force(z)).max() < 1e-12
    assert law.by_motion(z) == pytest.approx(-10.0 * 1e-3 / (1.0 - 1.0 / z), rel=1e-6)  # the sum of velocity


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_longest_latency_is_where_the_eigenvalues_say(scale):
    drawn, law = _loop()
    setup, totals = loop_model.with_springs(drawn, scale), [0.001 * n for n in range(1, 200)]
    longest = loop_model.longest_latency(setup, law, totals)

    def grows(total: float) -> float:
        late = loop_model.with_latency(setup, loop_model.share_latency(total))
        largest = np.abs(np.linalg.eigvals(closed_loop(late, law)[0])).max()
        return math.log(max(float(largest), 1e-12)) / 0.001

    assert grows(longest) <= loop_model.SLOWEST < grows(longest + 0.001)
    assert loop_model.longest_latency(setup, law, totals[:3]) == math.inf
