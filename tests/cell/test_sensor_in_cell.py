"""The exact wrist wrench at every instant of a run against Newton and Euler; tare, latency."""

from typing import Any

import mujoco
import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.cell import Cell
from tests.cell import cells
from tests.cell.fields import plane, sphere

GRAVITY = np.array([0.0, 0.0, -9.81])


class NewtonEuler:
    """Collects the difference between sensor and Newton-Euler at every instant.

    After a step the engine's poses still belong to the instant before it, as do its sensors; only positions
    and speeds have moved on, so the speeds are kept from one look to the next. The acceleration is what the
    speeds changed by: the engine's own is that before its implicit integration, with which nothing ever
    moves.
    """

    def __init__(self, cell: Cell) -> None:
        self.worst: list[Array] = []
        self._speeds = cell.data.qvel.copy()
        self.run = cell.run(cells.EachStep(self))

    def __call__(self, model: Any, data: Any) -> None:
        origin, R = data.site("sensor").xpos, data.site("sensor").xmat.reshape(3, 3)
        qd, qdd = self._speeds, (data.qvel - self._speeds) / model.opt.timestep
        force, torque = np.zeros(3), np.zeros(3)
        for name in ("tool_mount", "head"):
            body = model.body(name).id
            J, J_turn, J_dot, J_turn_dot = np.zeros((4, 3, model.nv))
            mujoco.mj_jacBodyCom(model, data, J, J_turn, body)
            mujoco.mj_jacDot(model, data, J_dot, J_turn_dot, data.xipos[body], body)
            linear, angular, turning = J @ qdd + J_dot @ qd, J_turn @ qdd + J_turn_dot @ qd, J_turn @ qd
            R_inertia = data.ximat[body].reshape(3, 3)
            inertia = R_inertia @ np.diag(model.body_inertia[body]) @ R_inertia.T
            pull = model.body_mass[body] * (linear - GRAVITY) - data.xfrc_applied[body, :3]
            force += pull
            torque += inertia @ angular + np.cross(turning, inertia @ turning) - data.xfrc_applied[body, 3:]
            torque += np.cross(data.xipos[body] - origin, pull)
        self.worst.append(np.abs(data.sensordata - np.concatenate([R.T @ force, R.T @ torque])))
        self._speeds = data.qvel.copy()


def test_the_sensor_reads_m_a_minus_g_at_every_instant_less_the_contact_when_it_presses_and_slides():
    tilted = cells.tool_pose(0.06, -0.45, 0.25, (0.3, -0.2, 0.4))
    stroke = cells.free_stroke(
        cells.tool_pose(0, -0.5, 0.2), tilted, cells.tool_pose(0.1, -0.5, 0.2), feed=0.2
    )
    free = NewtonEuler(cells.cell_for(cells.ideal("arc", cells.EVERY_STEP), stroke))
    assert free.run.trace.tcp_speed_m_s.max() > 0.15
    assert np.max(free.worst) < 1e-9
    scenario = cells.ideal("force", cells.EVERY_STEP, "spindle.speed_rpm=6000", "sensor.force_noise_n=0.5")
    stroke = cells.pressing_stroke(height=0.002, slide=0.002, hold=0.2, lift=0.002)
    pressed = NewtonEuler(cells.cell_for(scenario, stroke, part=cells.part_under(sphere(0.1))))
    assert pressed.run.stop_reason is None
    assert pressed.run.trace.normal_force_n.max() > 10.0
    assert np.max(pressed.worst) < 1e-9


def test_the_tare_takes_the_bias_out_which_the_logs_exact_wrench_never_had():
    pressed = cells.on_plane("sensor.force_bias_n=5", "sensor.torque_bias_nm=0.2", hold=1.5, lift=0.01).run()
    np.testing.assert_allclose(pressed.log["wrench_raw_sensor"][300, :3], [0.0, 0.0, -2.0 * 9.81], atol=0.01)
    measured = pressed.log["wrench_measured_tool"]
    assert np.abs(measured[:100, :3]).max() > 1.0
    assert np.abs(measured[700:1000] / [0.05, 0.05, 0.05, 0.02, 0.02, 0.02]).max() < 1.0
    process = pressed.log.fed
    true = pressed.log["normal_force_n"][process][-200:]
    np.testing.assert_allclose(true, 20.0, atol=0.1)
    np.testing.assert_allclose(measured[process][-200:, 2], true, atol=0.05)


def test_a_wrongly_believed_tool_mass_shows_by_how_far_the_tool_has_turned_since_the_tare():
    """The force loop holds 20 N of what it believes; the rest is the surplus mass by its share's change."""
    lean, surplus = 0.6, 0.2 * 2.0 * 9.81
    start = cells.along_tool(cells.tool_pose(0.0, -0.5, 0.1, (lean, 0.0, 0.0)), z=-0.02)
    stroke = cells.pressing_stroke(hold=1.5)._replace(lead_in=cells.path_through(start, cells.TOUCH))
    scenario = cells.ideal("force", "sensor.payload_mass_error=0.2")
    run = cells.cell_for(scenario, stroke, part=cells.part_under(plane())).run()
    expected = 20.0 - surplus * (1.0 - np.cos(lean))
    assert run.trace.normal_force_n[-1] == pytest.approx(expected, abs=0.1)
