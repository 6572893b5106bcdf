"""The arm with motors for hand guiding."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.config import GuideConfig, RobotConfig, Scenario
from polish_sim.errors import InputError
from polish_sim.geometry import load_part
from polish_sim.hand_guiding import arm
from polish_sim.hand_guiding.cell import BRAKED_S, GuidingRun, Hand, HandMotion, run_guided
from polish_sim.hand_guiding.law import MODES
from polish_sim.models import workpiece_path
from polish_sim.spatial import transform

IDEAL = Scenario(robot=RobotConfig(arm="ideal"))
POINT_HAND = Hand(4000.0, 200.0, 0.0, 0.0)


def guide(
    offset: Array, seconds: float, mode: str, hand: Hand = POINT_HAND, held: float = 0.0, **changed: float
) -> GuidingRun:
    """Hold the tool a fixed way from home; servos hold first, without the hand."""
    scenario = replace(IDEAL, guide=replace(GuideConfig(), **changed))
    n, T = round(seconds / 0.001), arm.home_pose()
    positions = np.tile(T[:3, 3] + offset, (n, 1))
    servos = (np.arange(n) < held / 0.001).astype(float)
    motion = HandMotion(positions, np.zeros((n, 3)), np.tile(T[:3, :3], (n, 1, 1)), 1.0 - servos)
    guided = arm.guided_arm(scenario, mode, arm.torque_arm(scenario), arm.believe_arm(scenario), hand)
    return run_guided(guided, np.array(arm.HOME), motion, servos)


def test_the_model_is_the_cell_s_with_motors_for_servos_and_a_part_before_it_weighs_on_nothing():
    model = arm.torque_arm(IDEAL)
    assert model.nu == 6
    assert np.all(model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE)
    np.testing.assert_allclose(model.actuator_forcerange[:, 1], [150.0] * 3 + [28.0] * 3)
    np.testing.assert_allclose(model.dof_frictionloss[:6], [7.0, 7.0, 5.0, 1.5, 1.5, 1.5])
    damping = model.dof_damping.reshape(model.nv, -1)[:6, 0]
    np.testing.assert_allclose(damping, [10.0, 10.0, 8.0, 2.0, 2.0, 2.0])
    assert not model.body_gravcomp.any()
    T_base_part = transform(np.eye(3), np.array([0.1, -0.5, 0.05]))
    plate = arm.LaidPart(load_part(workpiece_path("plate")), T_base_part)
    beside = arm.torque_arm(IDEAL, plate)
    np.testing.assert_allclose(beside.body("part").pos, T_base_part[:3, 3])
    assert beside.geom("part").contype == beside.geom("part").conaffinity == 0
    weights = []
    for either in (model, beside):
        data = mujoco.MjData(either)
        data.qpos[:6] = arm.HOME
        mujoco.mj_forward(either, data)
        assert data.ncon == 0
        weights.append(data.qfrc_bias.copy())
    np.testing.assert_array_equal(*weights)


def test_the_wrist_sensor_feels_the_hand():
    """Between a pull of 8 N and none the sensor's plane sees 8 N less carried by the arm, in base axes."""
    pulled, free = (guide(np.array([way, 0.0, 0.0]), 0.2, "gravity") for way in (0.002, 0.0))
    np.testing.assert_allclose(pulled.rows["force"][0], [8.0, 0.0, 0.0], atol=1e-6)
    assert np.abs(free.rows["q"][-1] - arm.HOME).max() < 1e-6  # the believed weight carries the arm
    R = pulled.rows["R_base_tool"][-1]
    change = R @ (pulled.rows["raw"][-1, :3] - free.rows["raw"][-1, :3])
    np.testing.assert_allclose(change, -pulled.rows["force"][-1], atol=0.05)


def test_what_the_model_lacks_is_tared_while_the_servos_hold():
    """2 kg missing from the payload: the arm stays when the servos release it, and sinks without the tare."""
    moved = []
    for tare in (1.0, 0.0):
        free = Hand(0.0, 0.0, 0.0, 0.0)
        q = guide(np.zeros(3), 1.5, "gravity", free, 0.5, payload_kg=2.0, tare=tare).rows["q"]
        moved.append(np.abs(q[-1] - q[500]).max())
    assert moved[0] < 2e-3
    assert moved[1] > 0.05


@pytest.mark.parametrize("mode", MODES)
def test_the_brakes_end_the_motion_in_every_mode(mode):
    """Even where the law does not carry the arm; 2 kg missing are tared in 0.5 s and held."""
    run = guide(np.array([0.0, 0.2, 0.0]), 2.0, mode, held=0.5, joint_speed_limit_rad_s=0.5, payload_kg=2.0)
    assert "guide.joint_speed_limit_rad_s" in str(run.stop_reason)
    assert len(run.rows) == pytest.approx(run.stop_step + BRAKED_S / 0.001, abs=2)
    assert np.abs(run.rows["qd"][-1]).max() < 0.02
    assert np.all(run.rows["force"][run.stop_step + 1 :] == 0.0)
    assert np.isfinite(run.rows["torque"]).all()


def test_links_that_touch_stop_the_arm_and_a_file_that_is_no_model_of_it_is_refused(tmp_path):
    """A soft hand pulls the tool home to the arm's foot; it is braked half a second after the touch."""
    run = guide(np.array([0.0, 0.6, -0.2]), 3.5, "inertia", Hand(200.0, 300.0, 0.0, 0.0))
    assert str(run.stop_reason).endswith("link_1_collision and tool_collision")
    assert len(run.rows) == pytest.approx(run.stop_step + BRAKED_S / 0.001, abs=2)
    file = tmp_path / "identified.xml"
    for rest, said in (("", "no MuJoCo model"), (PENDULUM, "no joint")):
        file.write_text("<mujoco>" + rest)
        with pytest.raises(InputError, match=f"identified.xml' .*{said}"):
            arm.chain_of_file(file)


PENDULUM = '<worldbody><body><joint name="hinge" type="hinge"/><geom size="0.1"/></body></worldbody></mujoco>'
