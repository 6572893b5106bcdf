"""The linear force loop by closed forms, and the cell's border of stability by the linear loop."""

import json
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from benchmarks.force_margins import press
from benchmarks.force_theory import noise_rms, surface_error
from benchmarks.loop_margins import SWINGS, analytic_margins, linear_loop, margins, response_of, swinging_arm
from polish_sim.arrays import Array
from polish_sim.cell.linear_arm import joints_about
from polish_sim.cli.score import show_border
from polish_sim.control import build_controller
from polish_sim.experiments import default_scenario
from polish_sim.row_file import Rows
from polish_sim.scenario_file import override
from polish_sim.scoring import border, loop_model
from polish_sim.scoring.loop_model import elastic_arm, plant_response
from polish_sim.scoring.measured_law import measure_law
from polish_sim.scoring.score import user_entry
from polish_sim.workers import Here, Result, Runner
from tests.cell.elastic import NO_HYSTERESIS, REAL, SPRINGS_ONLY

FORCE = override(default_scenario("force"), ["robot.arm=ideal"])
SETTINGS = ["robot.arm=ideal", "controller.force_filter_hz=10"]
PRESSED = override(default_scenario("force"), SETTINGS)
"""The loop of the model: a stiff arm. With a slower filter limits of speed bend the border first."""
ELASTIC = override(default_scenario("force"), [REAL])
HELD = [  # no loops across the tool axis, no friction of the pad, no gaps: what the linear model has
    "controller.look_ahead_s=10", "controller.position_p=0", "controller.orientation_p=0",
    "controller.orientation_i_hz=0", "controller.moment_p_rad_snm=0", "controller.moment_i_rad_s2nm=0",
    "controller.adaptive.normal_rate_1_s=0", "pad.friction=0", "robot.real.missed_every_s=0",
    "process.hold_s=6",
]  # fmt: skip


class PiLaw(NamedTuple):
    """State space of a filtered PI law on the force reading r: s' = A s + B r, speed = C s + D r."""

    A: Array  #: Shape (n, n)
    B: Array  #: Shape (n,)
    C: Array  #: Shape (n,)
    D: float

    def by_force(self, z):
        systems = z[:, None, None] * np.eye(len(self.B)) - self.A
        states = np.linalg.solve(systems, np.broadcast_to(self.B[:, None], (len(z), len(self.B), 1)))
        return states[:, :, 0] @ self.C + self.D

    def by_motion(self, z):
        return np.zeros_like(z)


def closed_loop(setup, law):
    """One step of the closed loop as a matrix, its eigenvalues the poles, and what noise of the reading adds:
    to plant, law, samples and commands under way, the newest first."""
    plant = loop_model.build_plant(setup)
    sizes = len(plant.B), len(law.B), setup.sensor_steps, setup.command_steps

    def step(state, noise=0.0):
        s, q, samples, commands = np.split(state, np.cumsum(sizes)[:-1])
        samples = np.append(plant.reading @ s + noise, samples)
        commands = np.append(law.C @ q + law.D * samples[-1], commands)
        s, q = plant.A @ s + plant.B * commands[-1], law.A @ q + law.B * samples[-1]
        return np.concatenate([s, q, samples[:-1], commands[:-1]])

    units = np.eye(sum(sizes))
    return np.column_stack([step(unit) for unit in units]), step(0.0 * units[0], 1.0)


def _loop():
    """The force loop of ``hybrid-pi`` (paper 1, eq. 5); its law's states: filtered reading and sum of it."""
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
    setup, law = _loop()
    found = forces(setup, law, np.random.default_rng(0).normal(0.0, 0.5, 60_000))
    assert noise_rms(setup, law, 0.5) == pytest.approx(np.std(found[5000:]), rel=0.08)
    error = np.abs(surface_error(setup, law)(np.array([0.1, 100.0])))
    assert error[0] < 0.01 * 5000.0
    assert error[1] > 0.9 * 5000.0


def forces(setup, law, noise):
    """Contact force of the closed loop in time [N], shape (n,), with noise in the sensor [N], shape (n,)."""
    (step, entry), plant = closed_loop(setup, law), loop_model.build_plant(setup)
    state, noisy, found = 0.0 * entry, 0.0, np.empty(len(noise))
    for k, draw in enumerate(noise):
        noisy += setup.sensor_blend * (draw - noisy)
        found[k] = plant.force @ state[: len(plant.B)]
        state = step @ state + entry * noisy
    return found


def integrator(crossover, delay):
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

    def reset(self, cycle_s):
        pass

    def step(self, measurement, target):
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

    def grows(total):
        late = loop_model.with_latency(setup, loop_model.share_latency(total))
        largest = np.abs(np.linalg.eigvals(closed_loop(late, law)[0])).max()
        return math.log(max(float(largest), 1e-12)) / 0.001

    assert grows(longest) <= loop_model.SLOWEST < grows(longest + 0.001)
    assert loop_model.longest_latency(setup, law, totals[:3]) == math.inf


def test_gain_and_delay_margins_of_the_model_hold_in_the_cell_within_8_and_5_percent():
    margins, bench = analytic_margins(PRESSED), border.build_bench(PRESSED)

    def later(delay):
        latency = PRESSED.robot.command_latency_s + delay
        return replace(PRESSED, robot=replace(PRESSED.robot, command_latency_s=latency))

    rest = press(bench, PRESSED)
    assert rest.resting
    assert rest.offset == pytest.approx(0.0, abs=0.1)
    assert press(bench, PRESSED, 0.92 * margins.gain, friction=False).resting
    beyond = press(bench, PRESSED, 1.08 * margins.gain, friction=False)
    assert not beyond.resting
    assert beyond.frequency == pytest.approx(margins.phase_crossover, rel=0.1)
    assert press(bench, later(0.95 * margins.delay), friction=False).resting
    beyond = press(bench, later(1.05 * margins.delay), friction=False)
    assert not beyond.stable
    assert beyond.frequency == pytest.approx(margins.crossover, rel=0.1)


def test_border_of_the_cell_lies_on_that_of_the_model_and_a_lost_run_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(border, "FINE_SCALES", (1.0, 3.0))
    entry, asked = user_entry("hybrid-pi", SETTINGS), ((1.0, 3.0), (0.008, 0.06))
    found = border.measure_border([entry], Runner(Rows(tmp_path), Here()), *asked)
    line = dict(zip(found.line_scales, found.lines["hybrid-pi"], strict=True))
    stable = [[rest.stable for rest in row] for row in found.rests["hybrid-pi"]]
    assert stable == [[latency <= line[scale] for scale in (1.0, 3.0)] for latency in (0.008, 0.06)]

    class Dying(Here):
        def results(self, tasks, work, group_of):
            for task in tasks:
                lost = "springs x 1, " in str(task)
                yield Result(task, None if lost else work(task), "died" if lost else None)

    def row(task):
        calm = border.Rest(True, True, 0.0, 0.0, 0.0)._asdict()
        return {"longest_s": 0.02} if task.case.text == border.MODEL else calm

    monkeypatch.setattr(border, "border_row", row)
    runner = Runner(Rows(tmp_path), Dying())
    found = border.measure_border([user_entry("hybrid-pi")], runner, *asked)
    assert [[rest.stable for rest in row] for row in found.rests["hybrid-pi"]] == [[None, True]] * 2
    assert runner.lost == 3
    assert show_border(found, tmp_path) == 0
    written = json.loads((tmp_path / "border.json").read_text())["controllers"]["hybrid-pi"]
    assert written["latency_stable_s"] == [None, 0.06]
    assert written["latency_stable_model_s"][0] is None


def test_slow_motion_presses_head_and_arm_in_series_and_hysteresis_is_elastic_in_small_swings():
    """The host's travel meets head and pad, 5000 N/m, in series with the gears and servos."""
    setup = loop_model.setup_of(override(ELASTIC, [NO_HYSTERESIS]))
    plant, z = loop_model.build_plant(setup), np.exp(np.array([0.5j]) * setup.dt)
    stiffness = abs(plant_response(plant, plant.force, z) / plant_response(plant, plant.position, z))[0]
    arm = setup.arm
    softer = arm.tool @ np.linalg.solve(arm.stiffness, arm.tool)
    behind = arm.host @ np.linalg.solve(arm.stiffness, arm.tool)  # what the encoders see of it
    assert stiffness == pytest.approx(1.0 / (1.0 / 5000.0 + softer - behind), rel=1e-3)
    assert 10e-6 < softer < 60e-6
    (about,) = joints_about(ELASTIC, loop_model.FORCE_POSE[None])
    stiff = [float(np.trace(swinging_arm(about, swing).stiffness)) for swing in (*SWINGS, 1.0)]
    assert np.all(np.diff(stiff) < 0.0)
    (lossless,) = joints_about(override(ELASTIC, [NO_HYSTERESIS]), loop_model.FORCE_POSE[None])
    alone = float(np.trace(elastic_arm(lossless).stiffness))
    assert stiff[-1] == pytest.approx(alone, rel=1e-3)
    assert np.linalg.eigvalsh(swinging_arm(about, 1e-4).damping).min() > -1e-9


@pytest.mark.parametrize(("name", "gain"), [("hybrid-pi", 1.4), ("hybrid-adaptive", 1.9)])
def test_the_border_of_stability_is_where_the_linear_model_says_and_shipped_laws_keep_off_it(name, gain):
    """Within 8% of gain, on springs alone; seen from below, where swings decay: beyond it limits end them."""
    named = f"controller.name={name}"
    scenario = override(ELASTIC, [*SPRINGS_ONLY, *HELD, named])
    response = linear_loop(scenario, swing=1.0)(loop_model.contour(0.001))
    bench, turns = border.build_bench(scenario), loop_model.turns_about_minus_one
    least = next(gain for gain in np.geomspace(0.1, 10.0, 461) if turns(gain * response) > 0)
    below = press(bench, scenario, 0.92 * least)
    assert below.resting
    assert 16.0 < below.frequency / (2.0 * math.pi) < 20.0
    assert not press(bench, scenario, 1.08 * least).resting
    # With hysteresis, whatever the arm swings by.
    found = analytic_margins(override(ELASTIC, [named]))
    assert found.gain > gain
    assert found.phase > math.radians(45.0)
    assert found.delay > 0.02


def test_without_the_notch_the_swing_of_the_tool_comes_back_turned_round_and_the_cell_swings_there():
    own = "arm_mode_hz=0", "observer_rad_s=30"
    settings = ["controller.name=hybrid-adaptive", *(f"controller.adaptive.{each}" for each in own)]
    scenario = override(ELASTIC, settings)
    law = border.linear_law_of(scenario)
    assert analytic_margins(scenario, law).gain == 0.0
    omega = 2.0 * math.pi * np.linspace(15.0, 40.0, 500)
    response = response_of(linear_loop(scenario, 0.0, law), 0.001)(omega)
    turned_round = int(np.argmin(np.abs(np.angle(-response))))
    assert abs(response[turned_round]) > 2.0
    rest = press(border.build_bench(scenario), scenario, 1.5)
    assert not rest.resting
    assert rest.frequency == pytest.approx(omega[turned_round], rel=0.1)
