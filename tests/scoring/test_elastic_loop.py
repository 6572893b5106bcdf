"""The force loop on elastic joints: the linear model against the simulated cell, and its margins."""

import math

import numpy as np
import pytest

from benchmarks.force_margins import press
from benchmarks.loop_margins import SWINGS, analytic_margins, linear_loop, response_of
from polish_sim.cell.linear_arm import joints_about
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.scoring import loop_model
from polish_sim.scoring.border import build_bench
from polish_sim.scoring.loop_model import elastic_arm, plant_response
from tests.cell.elastic import NO_HYSTERESIS, REAL, SPRINGS_ONLY

FORCE = override(default_scenario("force"), [REAL])
ADAPTIVE = "controller.name=hybrid-adaptive"
NO_NOTCH = "controller.adaptive.arm_mode_hz=0"
HELD = [  # no loops across the tool axis, no friction of the pad, no gaps: what the linear model has
    "controller.look_ahead_s=10", "controller.position_p=0", "controller.orientation_p=0",
    "controller.orientation_i_hz=0", "controller.moment_p_rad_snm=0", "controller.moment_i_rad_s2nm=0",
    "controller.adaptive.normal_rate_1_s=0", "pad.friction=0", "robot.real.missed_every_s=0",
    "process.hold_s=6",
]  # fmt: skip


def test_slow_motion_presses_head_and_arm_in_series_and_hysteresis_is_elastic_in_small_swings():
    """The host's travel meets head and pad, 5000 N/m, in series with the gears and servos."""
    setup = loop_model.setup_of(override(FORCE, [NO_HYSTERESIS]))
    plant, z = loop_model.build_plant(setup), np.exp(np.array([0.5j]) * setup.dt)
    stiffness = abs(plant_response(plant, plant.force, z) / plant_response(plant, plant.position, z))[0]
    arm = setup.arm
    softer = arm.tool @ np.linalg.solve(arm.stiffness, arm.tool)
    behind = arm.host @ np.linalg.solve(arm.stiffness, arm.tool)  # what the encoders see of it
    assert stiffness == pytest.approx(1.0 / (1.0 / 5000.0 + softer - behind), rel=1e-3)
    assert 10e-6 < softer < 60e-6
    # It is gone in large ones.
    (about,) = joints_about(FORCE, loop_model.FORCE_POSE[None])
    stiff = [float(np.trace(elastic_arm(about, swing).stiffness)) for swing in (*SWINGS, 1.0)]
    assert np.all(np.diff(stiff) < 0.0)
    (lossless,) = joints_about(override(FORCE, [NO_HYSTERESIS]), loop_model.FORCE_POSE[None])
    alone = float(np.trace(elastic_arm(lossless).stiffness))
    assert stiff[-1] == pytest.approx(alone, rel=1e-3)
    assert np.linalg.eigvalsh(elastic_arm(about, 1e-4).damping).min() > -1e-9


@pytest.mark.parametrize("settings", [["controller.name=hybrid-pi"], [ADAPTIVE]])
def test_the_border_of_stability_is_where_the_linear_model_says(settings):
    """Within 8% of gain, on springs alone: what hysteresis and friction damp is left out on both sides.

    What swings is seen below the border, where it decays: beyond it the loop is at its limits, and ends in
    one of two swings.
    """
    scenario = override(FORCE, [*SPRINGS_ONLY, *HELD, *settings])
    response, bench = linear_loop(scenario, swing=1.0)(loop_model.contour(0.001)), build_bench(scenario)
    gains, turns = np.geomspace(0.1, 10.0, 461), loop_model.turns_about_minus_one
    border = next(gain for gain in gains if turns(gain * response) > 0)
    below = press(bench, scenario, 0.92 * border)
    assert below.resting
    assert 16.0 < below.frequency / (2.0 * math.pi) < 20.0
    assert not press(bench, scenario, 1.08 * border).resting


def test_without_the_notch_the_swing_of_the_tool_comes_back_turned_round_and_the_cell_swings_there():
    scenario = override(FORCE, [ADAPTIVE, NO_NOTCH, "controller.adaptive.observer_rad_s=30"])
    assert analytic_margins(scenario).gain == 0.0
    omega = 2.0 * math.pi * np.linspace(15.0, 40.0, 500)
    response = response_of(linear_loop(scenario), 0.001)(omega)
    turned_round = int(np.argmin(np.abs(np.angle(-response))))
    assert abs(response[turned_round]) > 2.0
    rest = press(build_bench(scenario), scenario, 1.5)
    assert not rest.resting
    assert rest.frequency == pytest.approx(omega[turned_round], rel=0.1)


@pytest.mark.parametrize(("name", "gain"), [("hybrid-pi", 1.4), ("hybrid-adaptive", 1.9)])
def test_shipped_laws_have_margins_on_the_elastic_arm_whatever_it_swings_by(name, gain):
    found = analytic_margins(override(FORCE, [f"controller.name={name}"]))
    assert found.gain > gain
    assert found.phase > math.radians(45.0)
    assert found.delay > 0.02
