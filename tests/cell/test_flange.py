"""The active flange: the force it holds at any stroke, its weight, its ramp, and the end of its stroke."""

import math

import numpy as np
import pytest

from polish_sim.cell.guards import REASONS, STROKE
from polish_sim.cell.wrist_sensor import GRAVITY
from polish_sim.errors import PolishSimError
from polish_sim.experiments import default_scenario
from polish_sim.experiments.registry import check_flange
from polish_sim.log import TOUCH_PHASE
from polish_sim.scenario_file import override
from tests.cell.cells import EVERY_STEP, along_tool, cell_for, ideal, part_under, pressing_stroke, tool_pose
from tests.cell.fields import plane

STROKE_M = 0.034
FLANGE = [
    "controller.name=position", "head.stiffness_n_m=12000", "head.mass_kg=1.5", f"head.travel_m={STROKE_M}",
    "head.flange.bandwidth_hz=20",
]  # fmt: skip
EXACT = ["head.flange.friction_n=0", "head.flange.weight_error=0", "pad.friction=0"]


def held(depth: float, *changes: str, tilt: float = 0.0):
    """A run that presses the tool, tilted about x, ``depth`` [m] in and holds it for a second; and the exact
    contact force at the end [N]."""
    touch = tool_pose(0.0, -0.5, 0.2, (tilt, 0.0, 0.0))
    pressed = pressing_stroke(along_tool(touch, z=depth - 0.004), hold=1.5)
    stroke = pressing_stroke(touch, hold=1.5)
    stroke = stroke._replace(process=pressed.process, motion=pressed.motion, depth=depth)
    scenario = ideal("force", EVERY_STEP, *FLANGE, *EXACT, *changes)
    run = cell_for(scenario, stroke, part=part_under(plane(), touch)).run()
    return run, float(run.trace.normal_force_n[-100:].mean())


@pytest.mark.parametrize("share", [0.15, 0.85])
def test_at_rest_the_part_feels_the_set_force_at_any_stroke(share):
    run, at_rest = held(share * STROKE_M + 0.001)
    assert run.stop_reason is None
    assert run.trace.pad_travel_m[-1] == pytest.approx(share * STROKE_M, abs=2e-4)
    assert at_rest == pytest.approx(20.0, abs=0.02)


def test_at_rest_a_wrong_weight_is_missing_by_its_share_along_the_tool_and_the_slides_friction():
    """The tool points down, tilted by the angle: error x m g cos(angle) too much is lifted."""
    for angle in (0.0, 0.8):
        _, at_rest = held(0.018, "head.flange.weight_error=0.2", tilt=angle)
        assert at_rest - 20.0 == pytest.approx(-0.2 * 1.5 * GRAVITY * math.cos(angle), abs=0.03)
    _, at_rest = held(0.018, "head.flange.friction_n=3")
    assert abs(at_rest - 20.0) == pytest.approx(3.0, abs=0.01)


def test_the_force_rises_over_the_ramp_and_the_loop_lags_behind_it_and_fast_motion():
    """F = 2 + 18 t / T behind a first-order lag; the arm's own motion adds k v / (2 pi f), 0.7 N. Pressed in
    at v by the air it compresses: k v dt / (e^(2 pi f dt) - 1), in short steps k v / (2 pi f)."""
    soft = ["head.stiffness_n_m=2000", "head.damping_n_s_m=0"]
    run = held(0.018, "head.flange.ramp_s=0.4", "head.flange.start_force_n=2", *soft)[0].trace
    off_stop = run.time_s[np.argmax((run.pad_travel_m > 0.0) & (run.normal_force_n > 1.0))]
    for reached in (10.0, 18.0):
        expected = (reached - 2.0) / 18.0 * 0.4 + 1.0 / (2.0 * math.pi * 20.0)
        after = run.time_s[np.argmax(run.normal_force_n > reached)] - off_stop
        assert after == pytest.approx(expected, abs=0.03)
    gentle = held(0.018, "head.damping_n_s_m=0")[0].trace
    sinking = (gentle.phase == TOUCH_PHASE) & (gentle.pad_travel_m > 0.010) & (gentle.pad_travel_m < 0.014)
    speed = np.gradient(gentle.pad_travel_m, 0.001)[sinking].mean()
    lag = 12000.0 * speed * 0.001 / math.expm1(2.0 * math.pi * 20.0 * 0.001)
    assert gentle.normal_force_n[sinking].mean() - 20.0 == pytest.approx(lag, rel=0.02)


@pytest.mark.parametrize(("depth", "share"), [(0.0015, 0.02), (0.034, 0.97)])
def test_the_robot_stops_near_either_end_of_the_stroke(depth, share):
    run, _ = held(depth)
    assert str(run.stop_reason).startswith(REASONS[STROKE][:30])
    assert float(run.safety.protective_stop_measured.split("%")[0]) == pytest.approx(100 * share, abs=2.5)


@pytest.mark.parametrize(
    ("experiment", "controller", "named"),
    [("surface", "hybrid-pi", "hybrid-pi"), ("dual", "position", "dual"), ("arc", "position", "arc")],
)
def test_where_it_cannot_hold_the_force_it_is_refused(experiment, controller, named):
    changes = ["head.flange.bandwidth_hz=20", f"controller.name={controller}"]
    with pytest.raises(PolishSimError, match=named):
        check_flange(override(default_scenario(experiment), changes))
