"""Laws of hand guiding: one joint with known inertia, weight and friction; the arm with motors."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from polish_sim.config import GuideConfig, RobotConfig, Scenario
from polish_sim.errors import InputError
from polish_sim.geometry import load_part
from polish_sim.hand_guiding import arm
from polish_sim.hand_guiding import law as laws
from polish_sim.hand_guiding.cell import BRAKED_S, Hand, HandMotion, run_guided
from polish_sim.hand_guiding.law import MODES
from polish_sim.models import workpiece_path
from polish_sim.motion.serial_chain import HINGE, ChainGeometry, SerialChain, chain_model, link_parameters
from polish_sim.spatial import transform

DT = 0.001
MASS, ARM, ROTOR = 3.0, 0.4, 1.0
INERTIA = MASS * ARM**2 + ROTOR
COULOMB, VISCOUS, CREEP = 5.0, 8.0, 0.003
IDEAL = Scenario(robot=RobotConfig(arm="ideal"))
POINT_HAND = Hand(4000.0, 200.0, 0.0, 0.0)
PENDULUM = '<worldbody><body><joint name="hinge" type="hinge"/><geom size="0.1"/></body></worldbody></mujoco>'


@pytest.fixture
def belief():
    """A point mass on a rod that turns about a level axis, level at zero."""
    axis, gravity = np.array([[0.0, -1.0, 0.0]]), np.array([0.0, 0.0, -9.81])
    geometry = ChainGeometry(np.array([HINGE]), np.zeros((1, 3)), np.eye(3)[None], axis, gravity)
    links = link_parameters(MASS, np.array([ARM, 0.0, 0.0]), np.zeros((3, 3)))[None]
    friction = np.array([VISCOUS]), np.array([COULOMB])
    chain = SerialChain(geometry, links, np.array([ROTOR]), *friction, ("shoulder",), np.zeros((1, 3)))
    own = (np.array([value]) for value in (COULOMB, VISCOUS, CREEP, 150.0, 0.0, 0.0))
    return laws.Belief(chain_model(chain), *own)


def gains(mode, **changed):
    return laws.gains_of(mode, GuideConfig(encoder_rad=0.0, **changed), DT)


def torque_at(belief, mode, q, qd, qdd=0.0):
    memory = laws.build_memory(1)
    memory.q[0], memory.qd[0], memory.qdd[0] = q, qd, qdd
    laws.guide_by_hand(belief, gains(mode), memory, 1.0, DT)
    return float(memory.torque[0])


def limits():
    return laws.GuidingLimits(joint_speed=3.0, tool_speed=1.5, energy=40.0, lent=laws.Lent())


def test_each_mode_gives_back_its_share_of_weight_friction_and_inertia(belief):
    weight = MASS * 9.81 * ARM * math.cos(0.3)
    friction = 0.95 * (COULOMB + VISCOUS * 1.0)
    moving = [torque_at(belief, mode, 0.3, 1.0, 5.0) for mode in ("none", "gravity", "classical", "inertia")]
    expected = [0.0, weight, weight + friction, weight + friction + 0.8 * INERTIA * 5.0]
    np.testing.assert_allclose(moving, expected, rtol=1e-12)
    assert torque_at(belief, "classical", 0.3, 0.0) == pytest.approx(weight)
    assert torque_at(belief, "inertia", 0.0, 1.0, 1e4) == 150.0  # all that the motor has


def pushed(belief, law, hand, steps, rubbing):
    """A joint under the law and a hand's constant torque [N m], with friction by its speed."""
    memory, q, qd, reached = laws.build_memory(1), 0.0, 0.0, []
    for step in range(steps):
        laws.quantize_encoders(law, memory, np.array([q]), DT, step == 0)
        laws.guide_by_hand(belief, law, memory, 1.0, DT)
        weight = MASS * 9.81 * ARM * math.cos(q)
        qd += DT * (memory.torque[0] + hand - weight - rubbing(qd)) / INERTIA
        q += DT * qd
        reached.append(qd)
    return memory, reached


def test_a_held_share_of_inertia_is_what_the_hand_feels_less(belief):
    """Also where the inertia is taken for a fifth more than it is."""

    def rubbing(qd):
        return 0.95 * (COULOMB * math.tanh(qd / gains("inertia").sign_speed) + VISCOUS * qd)

    for share in (0.8, 0.96):
        _, reached = pushed(belief, gains("inertia", inertia_share=share), 0.5, 1500, rubbing)
        felt = 0.5 * 500 * DT / (reached[1499] - reached[999])
        assert felt == pytest.approx((1.0 - share) * INERTIA, rel=0.05)


def test_the_observer_finds_the_torque_of_the_hand_and_without_one_friction_is_left_to_the_joint(belief):
    def rubbing(qd):
        return COULOMB * min(max(qd / CREEP, -1.0), 1.0) + VISCOUS * qd

    memory, _ = pushed(belief, gains("assist", hand_felt=0.0), 2.0, 400, rubbing)
    assert memory.external[0] == pytest.approx(2.0, rel=0.05)
    memory, law = laws.build_memory(1), gains("assist")
    memory.q[0], memory.qd[0], memory.grip[0] = 0.3, 1.0, 1.0
    memory.impulse[0] = INERTIA * 1.0
    # The torque that keeps 1 rad/s without the hand: what the observer expects.
    for _ in range(300):
        memory.torque[0] = MASS * 9.81 * ARM * math.cos(0.3) + COULOMB + VISCOUS
        laws.guide_by_hand(belief, law, memory, 1.0, DT)
    assert memory.grip[0] == 0.0
    assert memory.torque[0] == pytest.approx(MASS * 9.81 * ARM * math.cos(0.3))


def test_an_elastic_joint_is_helped_the_way_it_was_moved_last(belief):
    """Also while it stands."""
    memory, law = laws.build_memory(1), gains("assist", hand_felt=0.0)._replace(start=1e-5)
    for speed, way in ((0.02, 1.0), (0.0, 1.0), (-0.02, -1.0)):
        memory.qd[0] = speed
        laws.guide_by_hand(belief, law, memory, 1.0, DT)
        eased = memory.torque[0] - memory.weight[0]
        assert eased == pytest.approx(0.95 * (COULOMB * way + VISCOUS * speed), abs=1e-9)


def lend(belief, law, seconds):
    """Watch a joint that keeps on moving at 1 rad/s."""
    memory, watched, code = laws.build_memory(1), limits(), 0
    memory.qd[0] = 1.0
    for _ in range(round(seconds / DT)):
        laws.guide_by_hand(belief, law, memory, 1.0, DT)
        code = code or laws.watch_guiding(watched, belief, law, memory, 0.4, DT)
    return watched, code


def test_compensation_fades_towards_speed_limits_and_one_that_lends_too_much_energy_is_stopped(belief):
    memory = laws.build_memory(1)
    for memory.qd[0], tool, share, code in (
        (1.0, 0.5, 1.0, 0), (2.85, 0.5, 0.5, 0), (1.0, 1.6, 0.0, laws.TOOL_SPEED),
        (3.1, 0.1, 0.0, laws.JOINT_SPEED),
    ):  # fmt: skip
        assert laws.watch_guiding(limits(), belief, gains("gravity"), memory, tool, DT) == code
        assert laws.fade_out(limits(), memory.qd, tool) == pytest.approx(share)
    law = gains("classical", coulomb_share=1.5, viscous_share=1.5)
    watched, code = lend(belief, law, 1.0)
    assert code == 0
    assert watched.lent.most == pytest.approx(0.5 * (COULOMB + VISCOUS), rel=1e-9)
    assert lend(belief, law, 10.0)[1] == laws.ENERGY
    watched, code = lend(belief, gains("classical"), 10.0)
    assert (watched.lent.most, code) == (0.0, 0)


def guide(offset, seconds, mode, hand=POINT_HAND, held=0.0, **changed):
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
    plate = load_part(workpiece_path("plate")), T_base_part
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
    change = pulled.rows["R_base_tool"][-1] @ (pulled.rows["raw"][-1, :3] - free.rows["raw"][-1, :3])
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
