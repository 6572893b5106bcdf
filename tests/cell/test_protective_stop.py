"""After a guard spoke: brakes, retract, standstill; the log continues, the controller is not called any
more."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.cell import CellRun
from polish_sim.cell.guards import CONTROLLER_ERROR, REASONS
from polish_sim.motion import JOINT_LIMITS
from tests.cell.cells import (
    EVERY_STEP,
    TOUCH,
    Law,
    along_tool,
    cell_for,
    free_stroke,
    ideal,
    joints_at,
    on_plane,
    part_under,
    pressing_stroke,
    stopped_at,
    tool_pose,
    way_through,
)
from tests.cell.fields import plane

LOST = "faults.events=sensor-dropout@contact+0.5"


def after(run: CellRun) -> slice:
    return slice(stopped_at(run), None)


@pytest.mark.parametrize(
    ("latency", "speed", "off", "rest"), [(0.004, 0.05, 0.05, 5e-3), (0.011, 0.02, 0.15, 1e-2)]
)
def test_after_a_stop_the_tool_goes_back(latency: float, speed: float, off: float, rest: float) -> None:
    """Pressed with 20 N on a plane when the sensor's reading is lost, half a second after contact."""
    settings = f"safety.stop_latency_s={latency}", f"safety.retract_speed_m_s={speed}"
    stopped = on_plane(LOST, *settings, hold=2.0).run()
    way, force = stopped.trace.tcp_position_m[after(stopped)], stopped.trace.normal_force_n[after(stopped)]
    assert way[-1, 2] - way[0, 2] == pytest.approx(0.030, abs=0.002)
    assert np.linalg.norm((way - way[0])[:, :2], axis=1).max() < 2e-4
    assert stopped.safety.retracted is True
    assert stopped.safety.retract_m == pytest.approx(0.030, abs=0.002)
    assert stopped.safety.stop_delay_s == pytest.approx(latency, abs=1e-9)
    assert force.max() < force[0] + 0.3
    assert np.diff(force[: np.argmax(force == 0.0)]).max() < 0.05
    assert force[-1] == 0.0
    assert stopped.trace.tcp_speed_m_s[after(stopped)].max() == pytest.approx(speed, rel=off)
    assert stopped.trace.tcp_speed_m_s[-1] < rest


@pytest.mark.parametrize(("speed", "deceleration"), [(0.1, 1.0), (0.05, 4.0)])
def test_the_braking_distance_is_v_squared_over_2a(speed: float, deceleration: float) -> None:
    """In free space, braked on the way; before the brakes the robot continues for the stop's latency."""
    poses = tool_pose(0.0, -0.5, 0.2), tool_pose(0.2, -0.5, 0.2)
    settings = EVERY_STEP, "faults.events=controller-nan@1.4", f"safety.stop_deceleration_m_s2={deceleration}"
    run = cell_for(ideal("arc", *settings), free_stroke(*poses, feed=speed)).run()
    way = run.trace.tcp_position_m[after(run)]
    gone = float(np.linalg.norm(way[-1] - way[0]))
    assert gone == pytest.approx(speed * 0.004 + speed**2 / (2.0 * deceleration), rel=0.1, abs=3e-4)
    assert run.safety.retracted is None  # nothing to retract from


def test_a_stopped_robot_does_not_ask_the_controller_any_more() -> None:
    asked: list[float] = []

    def insane(measurement: Any, target: Any) -> Array:
        asked.append(float(measurement.time))
        if len(asked) > 600:
            raise RuntimeError("broken")
        return np.array([0.0, 0.0, -0.01, 0.0, 0.0, 0.0])

    run = on_plane(controller=Law(insane), height=0.03).run()
    assert str(run.stop_reason).startswith(f"{REASONS[CONTROLLER_ERROR]}: RuntimeError: broken")
    assert len(asked) == 601
    assert run.steps > 700
    assert run.safety.retracted is True


def test_a_retract_that_meets_a_joints_end_goes_as_far_as_it_can() -> None:
    """The shoulder or elbow range is cut to what the retract of 30 mm would need half of."""
    cell = on_plane(LOST, hold=2.0)
    pressed, lifted = joints_at(tool_pose(0.0, -0.5, 0.096)), joints_at(tool_pose(0.0, -0.5, 0.112))
    joint = int(np.argmax(np.abs(lifted - pressed)))
    limits = cell.state.speedl.highest if lifted[joint] > pressed[joint] else cell.state.speedl.lowest
    limits[joint] = lifted[joint]
    run = cell.run()
    assert str(run.stop_reason).startswith("wrist sensor reading missing:")
    assert run.safety.retracted is False
    assert run.safety.retract_m == pytest.approx(0.016, abs=0.003)
    assert run.trace.normal_force_n[-1] == 0.0
    assert np.all((run.log["q_rad"] > JOINT_LIMITS[:, 0]) & (run.log["q_rad"] < JOINT_LIMITS[:, 1]))


def test_the_sensor_is_zeroed_again_before_a_stroke_if_it_is_to_be() -> None:
    above, way_down = along_tool(TOUCH, z=-0.01), along_tool(TOUCH, z=-0.005)
    first = pressing_stroke(hold=0.5, lift=0.01)
    second = first._replace(travel=way_through(above, way_down))
    part, drift, last = part_under(plane()), 0.2, []
    for retare in (False, True):
        cell = cell_for(ideal("force", EVERY_STEP), first, second._replace(retare=retare), part=part)
        cell.state.sensor.errors.creep[2] = 0.001 * drift
        trace = cell.run().trace
        last.append(trace.normal_force_n[trace.phase == 2][-1])
        if not retare:
            since_tare = trace.time_s[trace.phase == 2][-1] - 0.3
            assert last[0] == pytest.approx(20.0 - drift * since_tare, abs=0.2)
    assert last[1] - last[0] > drift * 2.5
