"""Exciting motions, and the motions an identified model is for."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from polish_sim.cell import tool_on_flange
from polish_sim.errors import InputError
from polish_sim.identification import excitation
from polish_sim.identification.excitation import Clearance, started_and_stopped
from polish_sim.identification.log_file import use_states
from polish_sim.identification.regressor import States
from polish_sim.identification.robot_model import clearance_of
from polish_sim.motion import forward
from tests.identification.known import LIMITS, RATE, SIGMA, arm_model, known_robot, played, write_log

KNOWN = known_robot(terms=("coulomb", "viscous"))
OTHERS = (known_robot(200, ("coulomb", "viscous"), seed).states for seed in range(10, 18))
USES = [excitation.use_matrix(KNOWN.model, KNOWN.base, states, SIGMA) for states in OTHERS]
USE = np.mean(USES, axis=0)
ROBOT = clearance_of(arm_model(), 6, also=("head_pad",))


def far(q):
    """The clearance of an arm with nothing around it."""
    return Clearance(np.ones((len(q), 1)), np.zeros((len(q), 1, 6)))


TASK = excitation.ExcitationTask(KNOWN.model, KNOWN.base, KNOWN.model.truth(), SIGMA, LIMITS, USE, far)


def test_gradients_are_the_slopes_of_the_cost():
    search = excitation.excitation_cost(replace(TASK, clearance=ROBOT))
    x, rng = 1.2 * KNOWN.motion.coefficients.ravel(), np.random.default_rng(0)
    _, gradient = search(x)
    way, step = rng.normal(size=x.size), 1e-6
    slope = (search(x + step * way)[0] - search(x - step * way)[0]) / (2.0 * step)
    assert gradient @ way == pytest.approx(slope, rel=1e-3)


def test_boxes_far_apart_may_touch_later():
    box = '<geom type="box" size="0.1 0.1 0.1"/>'
    body = f'<body pos="1 0.3 0"><joint/>{box}</body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{box}{body}</worldbody></mujoco>")
    assert clearance_of(model, 1)(np.zeros((1, 1))).distance.shape == (1, 1)


def designed(task):
    return excitation.design(task, np.random.default_rng(1), iterations=60)


def variance(motion, use):
    """Of the torques a motion predicts in a use."""
    return float(np.trace(np.linalg.solve(excitation.mean_information(TASK, motion), use)))


@pytest.fixture(scope="module")
def found():
    return designed(TASK)


def test_the_designed_motion_keeps_every_limit_and_tells_more_than_random_ones_most_of_its_own_task(found):
    states = found(np.linspace(0.0, 10.0, 997))
    assert LIMITS.holds(states, KNOWN.model.torque(states, KNOWN.model.truth()))
    random = excitation.allowed_motions(TASK, np.random.default_rng(2))
    assert variance(found, USE) < 0.6 * min(variance(next(random), USE) for _ in range(5))
    # The task: poses along a line, hardly moving.
    t = np.linspace(-1.0, 1.0, 100)[:, None]
    q = 0.4 * t * np.ones(6) + [0.0, -1.5, 1.5, -1.6, -1.5, 0.0]
    slow = States(q, np.full_like(q, 0.02), np.zeros_like(q))
    for_task = replace(TASK, use=excitation.use_matrix(KNOWN.model, KNOWN.base, slow, SIGMA))
    own = variance(designed(for_task), for_task.use)
    assert own < 0.8 * variance(found, for_task.use)


def test_clearance_is_known_where_the_arm_stands_straight_up_and_its_slopes_are_those_of_distance():
    up, folded = (np.array([[0.0, -np.pi / 2, elbow, 0.0, 0.0, 0.0]]) for elbow in (0.0, 3.1))
    assert ROBOT(up)[0].min() > 0.04
    assert ROBOT(folded)[0].min() < 0.0
    q, step = np.random.default_rng(3).uniform(-2.5, 2.5, (40, 6)), 1e-6
    distance, slope = ROBOT(q)
    # Just touching or just in sight: kinks.
    plain = (distance > 0.002) & (distance < 0.049)
    assert plain.sum() > 20
    for joint in range(6):
        ends = [ROBOT(q + sign * step * np.eye(6)[joint])[0] for sign in (1.0, -1.0)]
        np.testing.assert_allclose(slope[plain, joint], ((ends[0] - ends[1]) / (2 * step))[plain], atol=5e-3)


def test_the_motion_is_entered_and_left_from_rest_without_jumps():
    t = np.linspace(0.0, 14.0, 14001)
    states = started_and_stopped(KNOWN.motion, t, 2.0, 14.0)
    assert np.abs(states.qd[[0, -1]]).max() < 1e-12
    np.testing.assert_allclose(np.gradient(states.q, t, axis=0)[1:-1], states.qd[1:-1], atol=1e-4)
    np.testing.assert_allclose(np.gradient(states.qd, t, axis=0)[2:-2], states.qdd[2:-2], atol=0.02)
    np.testing.assert_allclose(states.q[2000], KNOWN.motion(np.zeros(1)).q[0], atol=1e-12)


def test_a_joint_motion_comes_back_with_its_speeds(tmp_path):
    known = known_robot(200)
    states = played(known.motion, 1)
    for use in (
        use_states(write_log(tmp_path / "log.csv", known.model, states)),
        use_states(_npz(tmp_path / "trajectory.npz", states.q)), use_states(tmp_path),
    ):  # fmt: skip
        # Sampled every 20 ms and joined by splines.
        assert np.abs(use.qd).max() == pytest.approx(np.abs(states.qd).max(), rel=0.02)
        assert np.abs(use.q[0] - states.q[0]).max() < 1e-3


def test_every_move_of_a_teaching_run_counts(tmp_path):
    t = np.arange(500) / RATE
    first, second = np.zeros((500, 6)), np.ones((500, 6))
    first[:, 0], second[:, 1] = 0.5 * t, 1.0 - 0.25 * t
    time, case = np.concatenate([t, t]), np.repeat([0.0, 1.0], 500)
    np.savez(tmp_path / "log.npz", time_s=time, q_rad=np.concatenate([first, second]), case=case)
    use = use_states(tmp_path)
    moved = [use.rows(use.q[:, 3] < 0.5), use.rows(use.q[:, 3] > 0.5)]
    for states, joint, speed in zip(moved, (0, 1), (0.5, -0.25), strict=True):
        assert len(states.q) > 90
        np.testing.assert_allclose(states.qd[:, joint], speed, atol=1e-6)
        assert np.abs(np.delete(states.qd, joint, axis=1)).max() < 1e-6


def test_along_a_path_the_tool_goes_at_the_feed_and_what_is_no_motion_is_refused(tmp_path):
    file = tmp_path / "line.csv"
    rows = [f"{x},0,0,0,0,1" for x in np.linspace(0.0, 100.0, 41)]
    file.write_text("\n".join(["x,y,z,i,j,k", *rows]), encoding="utf-8")
    use = use_states(file)
    step = 1e-4
    for k in (120, 250, 380):
        ends = [forward(use.q[k] + sign * step * use.qd[k]) @ tool_on_flange() for sign in (1.0, -1.0)]
        speed = np.linalg.norm(ends[0][:3, 3] - ends[1][:3, 3]) / (2.0 * step)
        assert speed == pytest.approx(0.01, rel=0.05)
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    np.savez(tmp_path / "wide.npz", time_s=np.arange(99.0), q_rad=np.zeros((99, 7)))
    _npz(tmp_path / "short.npz", np.zeros((1, 6)))
    for name, said in (
        ("other.npz", "holds no joint motion"), ("wide.npz", r"wanted \(n, 6\)"),
        ("short.npz", "two poses or more"), ("none", "cannot read the path"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=said):
            use_states(tmp_path / name)


def _npz(file, q):
    np.savez(file, time_s=np.arange(len(q)) / RATE, q_rad=q)
    return file
