"""Kinematics by an arm's table: forward, inverse, along paths; a process can change between makes."""

from dataclasses import asdict
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim import motion
from polish_sim.arms import ARMS, FIRST
from polish_sim.cell import Silent
from polish_sim.cell.scene import build_scene, tool_on_flange
from polish_sim.config import Scenario
from polish_sim.dual.task import prepare_dual
from polish_sim.errors import InputError, ReachError
from polish_sim.experiments import PAYLOAD_SCENARIO, default_scenario, run_payload_calibration
from polish_sim.experiments.assembly import check, strokes_for
from polish_sim.experiments.even_removal import planned
from polish_sim.experiments.free_space import prepare_arc
from polish_sim.experiments.surface import place_force, prepare_surface
from polish_sim.motion.kinematics import NOMINAL, forward, inverse_on_branch, use_arm, used_arm
from polish_sim.motion.rules.chain import build_chain
from polish_sim.motion.rules.limits import Arm
from polish_sim.motion.segment_rates import chain_rates, chebyshev_nodes, joint_motion
from polish_sim.scenario_file import load_scenario, override, to_toml
from polish_sim.smoothing.smooth import prepare_smooth
from polish_sim.spatial import apply, from_pose, inverse

# a [m], d [m], alpha [deg] as published.
TABLE = [
    (0.0, 0.1625, 90), (-0.425, 0.0, 0), (-0.3922, 0.0, 0), (0.0, 0.1333, 90), (0.0, 0.0997, -90),
    (0.0, 0.0996, 0),
]  # fmt: skip
TOOL_POINT = np.array([0.01, -0.02, 0.22])
HOME = np.array([1.30, -1.59, 1.51, -1.49, -1.57, -0.27])
T_FLANGE_TOOL = from_pose([0.0, 0.0, 0.22, 0.0, 0.0, 0.0])
T_FLANGE_TILTED = from_pose([0.01, -0.02, 0.2, 0.1, 0.2, 0.3])
T_BASE_WORK = from_pose([0.4, 0.1, 0.05, 0.2, -0.1, 0.7])
RNG = np.random.default_rng(500)
REACH = {"ur5e": 0.8172, "ur10e": 1.18425}  # from the shoulder's axis to the wrist, all joints at zero [m]


def test_frames_are_the_table_s_products_and_the_jacobian_their_derivative():
    q = np.random.default_rng(0).uniform(-2 * np.pi, 2 * np.pi, (200, 6))
    expected = [np.tile(np.eye(4), (200, 1, 1))]
    for (a, d, alpha), angles in zip(TABLE, q.T, strict=True):
        about_z, about_x = np.tile(np.eye(4), (200, 1, 1)), np.eye(4)
        about_z[:, :3, :3] = Rotation.from_euler("z", angles[:, None]).as_matrix()
        about_z[:, 2, 3], about_x[0, 3] = d, a
        about_x[:3, :3] = Rotation.from_euler("x", alpha, degrees=True).as_matrix()
        expected.append(expected[-1] @ about_z @ about_x)
    np.testing.assert_allclose(motion.link_frames(q), np.stack(expected, axis=1), atol=1e-14)
    np.testing.assert_array_equal(forward(q), motion.link_frames(q)[:, 6])
    for q in np.random.default_rng(0).uniform(-2 * np.pi, 2 * np.pi, (20, 6)):
        for dq, column in zip(1e-5 * np.eye(6), motion.jacobian(q, TOOL_POINT).T, strict=True):
            rate = (forward(q + dq) - forward(q - dq)) / 2e-5
            W = rate[:3, :3] @ forward(q)[:3, :3].T
            expected = [*rate[:3] @ np.append(TOOL_POINT, 1.0), W[2, 1], W[0, 2], W[1, 0]]
            np.testing.assert_allclose(column, expected, atol=1e-9)


def angle_difference(q, reference):
    return np.abs(np.angle(np.exp(1j * (q - reference))))


def reachable(solutions):
    return solutions[~np.isnan(solutions[:, 0])]


@pytest.mark.parametrize("aligned", [0.0, np.pi])
def test_an_aligned_wrist_keeps_wrist_3_where_it_was_and_a_stretched_arm_is_found(aligned):
    q = np.array([0.5, -1.2, 1.4, 0.3, aligned, 0.9])
    np.testing.assert_allclose(motion.inverse_near(forward(q), q), q, atol=1e-7)
    q[[2, 4]] = 0.0, 1.1
    T = forward(q)
    np.testing.assert_allclose(forward(motion.inverse_near(T, q)), T, atol=1e-9)


@pytest.fixture(autouse=True)
def _back_to_the_first():
    yield
    use_arm(FIRST)


@pytest.mark.parametrize("name", ARMS)
def test_all_solutions_reach_the_pose_and_the_choice_is_the_nearest_inside_the_limits(name):
    use_arm(name)
    assert forward(np.zeros(6))[0, 3] == pytest.approx(-REACH[name], abs=1e-12)  # as its maker says
    eight = 0
    for q in np.random.default_rng(4).uniform(-np.pi, np.pi, (200, 6)):
        T = forward(q)
        found = reachable(motion.inverse_all(T, 0.0))
        np.testing.assert_allclose(forward(found), np.tile(T, (len(found), 1, 1)), atol=1e-9)
        assert angle_difference(found, q).max(axis=1).min() < 1e-9
        np.testing.assert_allclose(motion.nearest_solution(T, q, False), q, atol=1e-9)
        assert np.abs(found).max() <= np.pi
        for i in range(len(found) - 1):
            assert angle_difference(found[i + 1 :], found[i]).max(axis=1).min() > 1e-6
        eight += len(found) == 8
    assert eight > 100
    # Of all solutions with every joint turned by -2 to 2 full turns.
    rng, (low, high), turns = np.random.default_rng(8), motion.JOINT_LIMITS.T, 2 * np.pi * np.arange(-2, 3)
    for _ in range(100):
        q_near = rng.uniform(low, high)
        T = forward(q_near + rng.normal(0, 0.3, 6))
        angles = reachable(motion.inverse_all(T, 0.0))[..., None] + turns
        inside = (angles >= low[:, None]) & (angles <= high[:, None])
        away = np.where(inside, np.abs(angles - q_near[:, None]), np.inf)
        listed = np.take_along_axis(angles, away.argmin(axis=2)[..., None], axis=2)[..., 0]
        nearest = listed[np.sum((listed - q_near) ** 2, axis=1).argmin()]
        np.testing.assert_allclose(motion.inverse_near(T, q_near), nearest, atol=1e-12)
    T = forward(HOME)
    T[:3, 3] = [0.0, -1.9, 0.2]
    assert np.isnan(motion.nearest_solution(T, HOME, True)).all()
    with pytest.raises(ReachError, match=r"\(0\.0, -1900\.0, 200\.0\) mm"):
        motion.inverse_near(T, HOME)


def test_track_follows_a_smooth_motion_and_names_joints_beyond_limits_singular_and_unreached_places():
    t = np.linspace(0, 1, 2000)[:, None]
    q = HOME + 0.4 * np.sin(2 * np.pi * t * np.array([1, 2, 1, 3, 1, 2]))
    path = motion.track(forward(q) @ T_FLANGE_TOOL, T_FLANGE_TOOL, HOME)
    np.testing.assert_allclose(path.q, q, atol=1e-9)
    assert path.first_unreachable is path.first_beyond_limit is path.limit_joint is None
    assert path.largest_step < 0.01
    assert path.smallest_singular_value > 0.01
    q = np.linspace([*HOME[:5], 5.8], [*HOME[:5], 6.8], 100)
    path = motion.track(forward(q) @ T_FLANGE_TOOL, T_FLANGE_TOOL, q[0])
    assert path.first_beyond_limit == np.argmax(q[:, 5] > 2 * np.pi)
    assert path.limit_joint == 5
    q = np.linspace([*HOME[:4], -0.5, HOME[5]], [*HOME[:4], 0.5, HOME[5]], 101)
    path = motion.track(forward(q) @ T_FLANGE_TOOL, T_FLANGE_TOOL, q[0])
    assert path.smallest_singular_index == 50
    assert path.smallest_singular_value < 1e-6
    poses = np.repeat(forward(HOME[None]) @ T_FLANGE_TOOL, 100, axis=0)
    poses[:, 1, 3] -= np.linspace(0, 1, 100)
    path = motion.track(poses, T_FLANGE_TOOL, HOME)
    distance = np.linalg.norm(poses[:, :3, 3], axis=1)
    assert path.first_unreachable is not None
    assert 0.7 < distance[path.first_unreachable] < 0.95
    assert np.isnan(path.q[path.first_unreachable :]).all()
    before = slice(path.first_unreachable)
    np.testing.assert_allclose(forward(path.q[before]) @ T_FLANGE_TOOL, poses[before], atol=1e-9)
    assert path.smallest_singular_value < 0.1
    beyond = motion.track(poses[path.first_unreachable :], T_FLANGE_TOOL, HOME)
    assert (beyond.first_unreachable, beyond.largest_step) == (0, 0.0)


def one_segment(q, step, turn=0.0, roll=0.0):
    """A segment that starts where the joints put the tool, seen from a moved and turned work frame."""
    T = inverse(T_BASE_WORK) @ forward(q) @ T_FLANGE_TILTED
    normal = np.cross(T[:3, 2], [0.3, 0.2, 0.9])
    turned = Rotation.from_rotvec(turn * normal / np.linalg.norm(normal)).as_matrix()
    end = turned @ T[:3, :3] @ Rotation.from_rotvec([0.0, 0.0, roll]).as_matrix()
    tips = np.array([T[:3, 3], T[:3, 3] + T_BASE_WORK[:3, :3].T @ step])
    return build_chain(tips, np.stack([T[:3, :3], end])), Arm(T_BASE_WORK, T_FLANGE_TILTED, q)


def test_the_branch_s_solution_is_the_configuration_itself_and_out_of_reach_there_is_none():
    rng = np.random.default_rng(0)
    out = np.empty(6)
    for q in rng.uniform(-2.0 * np.pi, 2.0 * np.pi, (500, 6)):
        if min(abs(np.sin(q[2])), abs(np.sin(q[4]))) > 0.01:
            assert inverse_on_branch(forward(q), q + 1e-4 * rng.normal(size=6), out)
            np.testing.assert_allclose(forward(out), forward(q), atol=1e-12)
            np.testing.assert_allclose(out, q, atol=1e-9)
    T, before = forward(HOME), out.copy()
    T[0, 3] += 2.0
    assert not inverse_on_branch(T, HOME, out)
    np.testing.assert_array_equal(out, before)


@pytest.mark.parametrize(("turn", "roll"), [(0.0, 0.0), (0.3, 0.0), (0.4, -0.5)])
def test_each_derivative_is_that_of_the_one_before_to_the_tools_end(turn, roll):
    chain, arm = one_segment(HOME, np.array([0.03, 0.05, -0.02]), turn, roll)
    u = np.linspace(0.0, 1.0, 2001)
    columns = [column[0] for column in chain_rates(chain, u, arm)]
    for lower, higher in pairwise(columns):
        slope = (lower[2:] - lower[:-2]) / (u[2:] - u[:-2])[:, None]
        np.testing.assert_allclose(higher[1:-1], slope, atol=2e-6 * np.abs(higher).max())
    end = inverse(T_BASE_WORK) @ forward(columns[0][-1]) @ T_FLANGE_TILTED
    np.testing.assert_allclose(end[:3, 3], chain.tips[1], atol=1e-12)
    np.testing.assert_allclose(end[:3, :3], chain.rotations[1], atol=1e-12)


def test_in_time_the_chain_rule_holds_and_ways_out_of_reach_or_range_are_named():
    """Along a segment at u = t^3: the tool's derivatives in time give the joints' own."""
    chain, arm = one_segment(HOME, np.array([0.03, 0.05, -0.02]))
    t = np.linspace(0.2, 0.9, 7)
    u, rates = t**3, chain_rates(chain, t**3, arm)
    step = chain.lengths[0] * chain.directions[0]
    speeds = np.stack([3.0 * t**2, 6.0 * t, np.full(7, 6.0)])
    linear = speeds[:, :, None] * step
    tips = chain.tips[0] + u[:, None] * step
    rotations = np.repeat(chain.rotations[:1], 7, axis=0)
    found = joint_motion(tips, rotations, linear, np.zeros((3, 7, 3)), arm)
    a, b, c = speeds[:, :, None]
    f1, f2, f3 = rates.first[0], rates.second[0], rates.third[0]
    np.testing.assert_allclose(found.q, rates.q[0], atol=1e-14)
    np.testing.assert_allclose(found.first, f1 * a, atol=1e-10)
    np.testing.assert_allclose(found.second, f2 * a**2 + f1 * b, atol=1e-9)
    np.testing.assert_allclose(found.third, f3 * a**3 + 3.0 * f2 * a * b + f1 * c, atol=1e-8)
    chain, arm = one_segment(HOME, np.array([2.0, 0.0, 0.0]))
    with pytest.raises(ReachError, match="segment 1"):
        chain_rates(chain, chebyshev_nodes(9), arm)
    chain, arm = one_segment(HOME + [0.0, 0.0, 0.0, 0.0, 0.0, 2.0 * np.pi], np.full(3, 1e-3), roll=0.6)
    with pytest.raises(ReachError, match="leaves its range in segment 1"):
        chain_rates(chain, chebyshev_nodes(9), arm)


@pytest.mark.parametrize("name", ARMS)
def test_the_model_stands_where_the_table_says_with_its_links(name):
    model = build_scene(override(default_scenario("arc"), [f"robot.arm={name}"]), None, None)
    data = mujoco.MjData(model)
    assert used_arm() is ARMS[name]
    for q in RNG.uniform(-2.0, 2.0, (5, 6)):
        data.qpos[:6] = q
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.site("flange").xpos, forward(q)[:3, 3], atol=1e-9)
    assert model.actuator_forcerange[:, 1] == pytest.approx(ARMS[name].torque)
    for number, link in enumerate(ARMS[name].links, 1):
        body = model.body(f"link_{number}")
        assert body.mass[0] == pytest.approx(link.mass)
        np.testing.assert_allclose(body.ipos, link.center, atol=1e-12)
        assert sum(body.inertia) == pytest.approx(sum(link.inertia[:3]), rel=1e-6)


def test_a_make_brings_its_gears_leaves_what_is_set_by_name_and_an_unknown_one_is_refused(tmp_path):
    base = default_scenario("arc")
    other = override(base, ["robot.real.encoder_rad=1e-5", "robot.arm=ur10e", "robot.real.gear_ratio=77"])
    assert other.robot.real.coulomb_nm == ARMS["ur10e"].gears["coulomb_nm"]
    assert (other.robot.real.encoder_rad, other.robot.real.gear_ratio) == (1e-5, 77.0)
    (tmp_path / "config.toml").write_text(to_toml(other), encoding="utf-8")
    assert load_scenario(tmp_path / "config.toml", base) == other
    back = override(other, ["robot.arm=ur5e"])
    changed = {k for k, v in asdict(back.robot.real).items() if v != asdict(base.robot.real)[k]}
    assert changed == {"encoder_rad", "gear_ratio"}
    with pytest.raises(InputError, match=r"ideal, ur10e, ur5e"):
        override(Scenario(), ["robot.arm=ur20"])
    with pytest.raises(ValueError, match="read-only"):
        NOMINAL[1, 0] = 0.2


def checked(name, arm, *changes):
    return check(override(default_scenario(name), [f"robot.arm={arm}", *changes]))


def test_what_takes_a_checked_scenario_computes_with_its_arm_whatever_was_used_before():
    """Places and circles are kept: the second call of each finds what the first one worked out."""

    def on_surface(scenario):
        return prepare_surface(*planned(scenario))

    for prepare, name in ((prepare_arc, "arc"), (place_force, "force"), (on_surface, "surface")):
        scenarios = [checked(name, arm, "plan.stepover_m=0.05") for arm in ("ur5e", "ur10e")]
        starts = []
        for scenario in (*scenarios, *scenarios):
            found = prepare(scenario)
            assert used_arm() is ARMS[scenario.robot.arm]
            tip = apply(found.reach.T_base_work, found.path.positions_work[:1])[0]
            tool = forward(found.reach.q_start) @ tool_on_flange()
            assert np.linalg.norm(tool[:3, 3] - tip) < 0.012  # lifted, or pressed in
            starts.append(found.reach.q_start)
        assert np.abs(starts[0] - starts[1]).max() > 0.1
        np.testing.assert_array_equal(starts[:2], starts[2:])


def test_strokes_and_smoothed_paths_are_of_their_scenarios_arm_and_two_robots_from_the_first_stage_on():
    pressed, smooth, dual = (checked(name, "ur10e") for name in ("force", "smooth", "dual"))
    place, arms = place_force(pressed), []

    class Watching(Silent):
        def stage(self, name):
            arms.append(used_arm())
            raise StopIteration

    for prepare in (lambda: strokes_for(pressed, place), lambda: prepare_smooth(smooth)):
        use_arm("ur5e")
        prepare()
        arms.append(used_arm())
    use_arm("ur5e")
    with pytest.raises(StopIteration):
        prepare_dual(dual, None, Watching())
    assert arms == 3 * [ARMS["ur10e"]]


def test_the_payload_of_another_make_is_found():
    found = run_payload_calibration(override(PAYLOAD_SCENARIO, ["robot.arm=ur10e", "payload.poses=6"]))
    assert found.figures["mass_error_relative"] < 0.01
