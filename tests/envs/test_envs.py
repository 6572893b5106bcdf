"""The environments: Gymnasium's own checks, seeds, ends, rewards; a controller as policy is itself."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

gym = pytest.importorskip("gymnasium", reason="the extra 'gym' is not installed")

import polish_sim.envs  # noqa: E402, F401
from polish_sim.cell.guards import LOST, REASONS  # noqa: E402
from polish_sim.config import ControllerConfig  # noqa: E402
from polish_sim.control import build_controller  # noqa: E402
from polish_sim.envs.policy import ControllerPolicy, evaluate, linear, save_linear  # noqa: E402
from polish_sim.envs.stepping import ACTIONS, OBSERVATION, SEEN  # noqa: E402
from polish_sim.errors import ConfigError, InputError  # noqa: E402
from polish_sim.experiments import run_experiment  # noqa: E402
from tests.kept import plate_file  # noqa: E402

SHORT = ("process.hold_s=1",)
SMOOTH = (
    "robot.real.coulomb_nm=[0,0,0,0,0,0]", "robot.real.lost_motion_rad=[0,0,0,0,0,0]",
    "robot.real.encoder_rad=0", "sensor.force_quantum_n=0", "sensor.torque_quantum_nm=0",
)  # fmt: skip
PLATE = (
    f"part.file={plate_file()}", "plan.pattern=raster", "plan.raster_direction=[1.0, 0.0, 0.0]",
    "plan.stepover_m=0.025",
)  # fmt: skip
REST = np.zeros((1, 3), np.float32)
TWO_NEWTON = np.full((1, 3), [0.2, 0.0, 0.0], np.float32)
PLACES = dict(zip(OBSERVATION, np.cumsum([0, *(width for width, _ in OBSERVATION.values())]), strict=False))


def make(name="PolishForce-v1", **kwargs):
    return gym.make(name, **{"settings": SHORT, "action": "force-and-feed", **kwargs})


@pytest.fixture(scope="module")
def env():
    made = make()
    yield made
    made.close()


def play(env, actions, seed=0):
    """Steps of an episode, the last action held, and the last info."""
    env.reset(seed=seed)
    steps, over = [], False
    while not over:
        *step, info = env.step(actions[min(len(steps), len(actions) - 1)])
        steps.append(step)
        over = step[2] or step[3]
    return steps, info


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.filterwarnings("error", "ignore:.*render.*|.*unwrapped.*")
def test_gymnasiums_checker_finds_nothing(action):
    from gymnasium.utils.env_checker import check_env

    check_env(make(action=action).unwrapped, skip_render_check=True)


def test_the_same_seed_gives_the_same_bytes_whatever_came_before(env):
    actions = (0.3 * np.random.default_rng(1).uniform(-1.0, 1.0, (300, 3))).astype(np.float32)
    first, _ = play(env, actions, 5)
    trace = env.unwrapped._recorder.trace[: env.unwrapped.steps].tobytes()
    play(env, actions[:50], 6)
    for one in (env, make()):  # a cell begun again runs as before
        again, _ = play(one, actions, 5)
        assert one.unwrapped._recorder.trace[: one.unwrapped.steps].tobytes() == trace
        for (seen, *step), (seen_first, *step_first) in zip(again, first, strict=True):
            assert (seen.tobytes(), *step) == (seen_first.tobytes(), *step_first)
    assert play(env, actions, 7)[0][0][0].tobytes() != first[0][0].tobytes()


def test_an_episode_ends_by_its_time_settled_and_a_command_of_two_newtons_presses_two_more(env):
    steps, info = play(env, REST)
    assert steps[-1][2:] == [False, True]
    assert (info["success"], info["stop_reason"]) == (True, "")
    row = info["figures"][0]
    assert row["stable"]
    assert row["settling_1n_s"] <= 0.6
    assert abs(info["privileged"]["normal_force_n"] - 20.0) <= row["max_error_n"]
    assert all(0.0 <= reward <= 1.0 for _, reward, *_ in steps)
    steps, info = play(env, TWO_NEWTON)
    assert info["figures"][0]["mean_error_n"] - row["mean_error_n"] == pytest.approx(2.0, abs=0.05)
    seen = np.mean([step[0][PLACES["force_error"]] for step in steps[-60:]]) * OBSERVATION["force_error"][1]
    assert seen == pytest.approx(-2.0, abs=0.3)  # by the sensor
    sparse = make(reward="sparse")
    for action, success in ((REST, 1.0), (TWO_NEWTON, 0.0)):  # 2 N too much is outside ±1 N
        steps, info = play(sparse, action)
        assert [reward for _, reward, *_ in steps] == [0.0] * (len(steps) - 1) + [success]
        assert info["success"] == bool(success)


def test_servo_holds_its_offset_in_free_space():
    env = make(action="servo")
    seen, _ = env.reset(seed=0)
    # 2 mm, -1 mm, 5 mm back; 0.01 rad about y
    action = np.array([0.4, -0.2, -1.0, 0.0, 0.2, 0.0], np.float32)
    for _ in range(50):
        seen = env.step(action)[0]
    error = seen[PLACES["position_error"] : PLACES["rotation_error"]] * OBSERVATION["position_error"][1]
    np.testing.assert_allclose(error[:2], [-0.002, 0.001], atol=1e-4)
    turned = seen[PLACES["rotation_error"] : PLACES["velocity"]] * OBSERVATION["rotation_error"][1]
    np.testing.assert_allclose(turned, [0.0, -0.01, 0.0], atol=5e-4)


def test_a_time_limit_truncates_a_fault_lost_contact_and_a_push_stop_the_robot():
    steps, info = play(make(time_limit_s=1.0), REST)
    assert len(steps) == pytest.approx(0.6 * 125, abs=1)
    assert (steps[-1][3], info["success"]) == (True, False)
    steps, info = play(make(settings=(*SHORT, "faults.events=sensor-frozen@contact+0.3")), REST)
    assert steps[-1][2]
    assert "frozen" in info["stop_reason"]
    env = make(action="twist")
    land = ControllerPolicy(env)
    for away, reason in ((-0.1, REASONS[LOST]), (1.0, "")):
        env.reset(seed=0)
        land.reset()
        steps, terminated = 0, False
        while not terminated and steps < 600:
            action = land(None) if steps < 150 else np.array([0, 0, away, 0, 0, 0], np.float32)
            _, _, terminated, truncated, info = env.step(action)
            steps += 1
        assert (terminated, truncated, info["success"]) == (True, False, False)
        assert info["stop_reason"]
        assert reason in info["stop_reason"]


def test_hybrid_pi_as_policy_at_500_hz_gives_the_controllers_force():
    """Actions are rounded to single precision, of which friction of the joints would make 0.2 N."""
    env = make(action="twist", rate_hz=500, settings=(*SHORT, *SMOOTH))
    own, policy = env.unwrapped, ControllerPolicy(env)
    (row,) = evaluate(env, policy, 1, seed=3)
    force = own._recorder.trace["normal_force_n"][: own.steps].copy()
    cell, episode = own.cell, own.episode
    cell.begin_again(episode.scenario, episode.part, np.random.default_rng(episode.noise))
    cell.use_controller(build_controller(ControllerConfig()))
    compiled = cell.run().trace.normal_force_n
    assert abs(len(compiled) - len(force)) <= 2
    count = min(len(compiled), len(force))
    assert np.abs(compiled[:count] - force[:count]).max() < 1e-3
    assert row["success"]
    assert 0.2 < row["settling_1n_s"] < 0.4


def test_set_forces_change_during_the_hold_and_each_is_scored():
    env = make(force_steps=2, force_range_n=(16.0, 24.0), settings=("process.hold_s=6",))
    _, info = play(env, REST)
    forces = [force for _, force in env.unwrapped._set]
    assert forces[0] == 20.0
    assert len(set(forces)) == len(info["figures"]) == 3
    assert all(abs(row["mean_error_n"]) < 0.5 for row in info["figures"][1:])
    assert all(16.0 <= force <= 24.0 for force in forces[1:])


def test_ranges_are_drawn_anew_and_reach_the_cell(tmp_path):
    file = tmp_path / "ranges.toml"
    file.write_text('"sensor.force_noise_n" = [0.1, 0.2]\n"robot.real.cold_friction" = [0.0, 0.3]\n')
    env = make(ranges=file, bodies=2)
    drawn = []
    for seed in range(3):
        _, info = env.reset(seed=seed)
        drawn.append(tuple(info["drawn"].values()))
        assert env.unwrapped.cell.sensor.noise[0] == drawn[-1][0]
        assert env.unwrapped.cell.real_arm.cold == drawn[-1][1]
    assert len(set(drawn)) == 3


@pytest.mark.parametrize(
    ("kwargs", "words"),
    [
        ({"action": "wrench"}, "force-and-feed"), ({"rate_hz": 300}, "500 Hz"),
        ({"ranges": {"part.file": (0, 1)}}, "part.file"),
        ({"ranges": {"sensor.force_noise_n": (0.1, 50.0)}}, "sensor.force_noise_n"),
        ({"ranges": {"sensor.force_noise_n": 0.1}}, "least, most"),
        ({"settings": ("experiment=surface",)}, "surface"), ({"bodies": 0}, "at least one"),
        ({"force_steps": 1, "force_range_n": (10.0, 60.0)}, "safety.force_limit_n"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(kwargs, words):
    with pytest.raises((InputError, ConfigError), match=words):
        make(**kwargs)


def test_without_gymnasium_one_error_says_what_to_install():
    program = "import sys; sys.modules['gymnasium'] = None; import polish_sim.envs"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert "pip install 'polish-sim[gym]'" in run.stderr


def test_a_path_is_followed_to_its_time_and_its_feed_is_the_actions():
    env = make("PolishSurface-v1", settings=(*PLATE, "process.max_feed_s=1", "process.feed_m_s=0.03"))
    assert env.action_space.shape == (4,)
    steps, info = play(env, np.array([[0.0, 0.0, 0.0, 1.0]], np.float32))
    fed = info["privileged"]["path_s_m"]
    assert steps[-1][3]
    assert info["figures"][0]["stable"]
    play(env, np.array([[0.0, 0.0, 0.0, 0.0]], np.float32))
    start = env.unwrapped.cell.strokes[0].start_s
    half = env.unwrapped.truth()["privileged"]["path_s_m"] - start
    assert half == pytest.approx(0.5 * (fed - start), rel=0.2)  # half of the feed, ramps aside


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasiums_vectors_give_what_each_gives_alone(env, mode):
    many = gym.make_vec("PolishForce-v1", 2, mode, settings=SHORT, action="force-and-feed")
    first, infos = many.reset(seed=[4, 5])
    action = np.full((2, 3), 0.02, np.float32)
    assert first[1].tobytes() == env.reset(seed=5)[0].tobytes()
    assert infos["privileged"]["normal_force_n"].shape == (2,)
    alone, end = play(env, action[:1], 5)
    for expected, reward, *over in alone:
        seen, rewards, terminated, truncated, infos = many.step(action)
        assert seen[1].tobytes() == expected.tobytes()
        assert rewards[1] == reward
        assert [terminated[1], truncated[1]] == over
    assert infos["success"][1] == end["success"]
    assert infos["figures"][1] == end["figures"]
    many.close()


def test_a_linear_policy_is_the_same_in_the_environment_and_as_controller(tmp_path):
    env = make(settings=(*SHORT, "robot.real.missed_every_s=0"))
    weights = np.zeros((3, SEEN + 4))
    weights[0, PLACES["force_error"]] = 0.5
    file = tmp_path / "policy.npz"
    save_linear(file, weights, env)
    (row,) = evaluate(env, linear(weights), 1)
    scenario = env.unwrapped.episode.scenario
    named = replace(scenario, controller=replace(scenario.controller, name=f"{file}:linear"))
    figures = run_experiment(named).figures
    assert row["success"]
    assert figures["settling_time_1n_s"] == pytest.approx(row["settling_1n_s"], abs=0.15)
    assert figures["overshoot_n"] == pytest.approx(row["overshoot_n"], abs=1.0)
    np.savez(file, weights=weights[:, :-1], action="twist", rate_hz=125)
    with pytest.raises(InputError, match="shape"):
        build_controller(named.controller)
