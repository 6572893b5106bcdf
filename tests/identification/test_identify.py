"""Plant a robot, move it, identify it: simulated, and from its log; logs that would spoil it are refused."""

import math

import numpy as np
import pytest

from polish_sim.config import RobotConfig
from polish_sim.errors import ConfigError, IdentificationError, InputError
from polish_sim.exchange.robot_log import columns_of, read_column_map, read_robot_recording
from polish_sim.identification import SCENARIO, STEP_S, IdentifySettings, log_file
from polish_sim.identification.arm import LoggedRobot, arm_of_table, build_simulated_arm, play_states
from polish_sim.identification.identify import identify_from_log, run_identification
from polish_sim.identification.log_file import RobotLog, log_of, spline_states, use_states
from polish_sim.identification.payload import weigh_from_logs
from polish_sim.identification.regressor import States
from polish_sim.motion.kinematics import used_arm
from polish_sim.motion.serial_chain import HINGE, SLIDE
from polish_sim.scenario_file import override
from tests.identification.known import SIGMA, known_robot, played, write_log

IDEAL = RobotConfig(arm="ideal")
HELD_BY_LINKS = ["robot.arm=ur5e", "robot.real.servo_side=link", "robot.real.kinematics=exact"]
KNOWN = known_robot()
PLANTED = KNOWN.model.truth() * np.repeat(np.linspace(0.85, 1.2, 14), [10] * 6 + [3] * 8)
MOTION = played(KNOWN.motion, 2)
BEFORE, GEARED = used_arm(), arm_of_table("ur10e")
SHARES = np.array([0.05, 0.06, 0.07, 0.04, 0.03, 0.05])
NAMES = ["time_s", *(f"q{j}_rad" for j in range(1, 7)), *(f"torque{j}_nm" for j in range(1, 7))]
LOGGED = known_robot(1000)
TABLE = np.column_stack([np.arange(1000) / 100.0, LOGGED.states.q, LOGGED.torque])


@pytest.fixture(scope="module")
def identified():
    return run_identification(IdentifySettings(periods=1, iterations=5, robot=IDEAL, payload=1.0, seed=1))


@pytest.mark.parametrize("wrong", [{"periods": 0}, {"periods": 2.5}, {"starts": 0}, {"payload": math.nan}])
def test_settings_out_of_their_range_are_refused_from_python_too(wrong):
    with pytest.raises(ConfigError, match=f"'{next(iter(wrong))}'"):
        IdentifySettings(**wrong)


def test_another_motion_is_predicted_far_better_than_by_the_drawing_and_a_block_is_weighed(identified):
    figures = identified.figures
    assert figures["nrms_heldout_mean"] <= 0.0013
    assert figures["nrms_heldout_drawing_mean"] > 5.0 * figures["nrms_heldout_mean"]
    assert figures["nrms_heldout_consistent_mean"] <= 1.05 * figures["nrms_heldout_mean"]
    assert figures["physically_consistent"]
    assert figures["clearance_min_m"] >= 0.02
    assert figures["error_over_crb"] < 1.6
    assert figures["interval_coverage"] > 0.8
    figures = identified.weighed.figures  # of the block it carries
    assert figures["payload_error_over_std"] < 2.0
    assert abs(figures["payload_mass_error_kg"]) < 0.01
    assert figures["payload_center_error_m"] < 0.003
    assert figures["payload_consistent"]


@pytest.mark.parametrize(("settings", "off"), [([], 1e-3), (HELD_BY_LINKS, 1e-2)])
def test_the_arm_at_rest_shows_its_weight_and_nothing_else(settings, off):
    arm = build_simulated_arm(override(SCENARIO, ["robot.arm=ideal", *settings]).robot)
    pose = np.array([0.3, -1.2, 1.0, -0.8, 0.7, 0.2])
    q = np.tile(pose, (round(0.05 / STEP_S), 1))
    log = play_states(arm, States(q, 0.0 * q, 0.0 * q))
    weight = arm.truth.torque(States(pose[None], np.zeros((1, 6)), np.zeros((1, 6))), arm.truth.truth())
    np.testing.assert_allclose(log.torque[-1], weight[0], atol=off)


def _identified(folder, states):
    file = write_log(folder / "log.csv", KNOWN.model, states, SIGMA, PLANTED)
    log = log_of(file, read_robot_recording(file, ("q_rad",)))
    return identify_from_log(LoggedRobot(KNOWN.model, np.zeros((6, 10))), log, spline_states(log))


def test_a_planted_robot_is_recovered_from_its_log_and_a_joint_that_rests_at_its_end_is_named(tmp_path):
    found = _identified(tmp_path, MOTION)
    off = (found.found.theta - KNOWN.base.combination @ PLANTED) / found.found.std
    # The rms of fifty-eight errors in their own standard deviations, plus what splines smooth away.
    assert float(np.sqrt(np.mean(off**2))) < 1.4
    assert max(found.figures["residual_over_noise_heldout"]) < 1.1
    rests = States(*(part.copy() for part in MOTION))
    end = slice(len(rests.q) // 2, None)
    rests.q[end, 2], rests.qd[end, 2], rests.qdd[end, 2] = rests.q[end, 2][0], 0.0, 0.0
    with pytest.raises(IdentificationError, match="no usable torque of elbow_joint"):
        _identified(tmp_path, rests)


def _geared_log(seed, carried=0.0):
    """A bare UR10e whose gears rub by load, root of speed and tooth, and torques with noise."""
    chain = GEARED.model.chain
    rubbing = np.array([[20.0, 9.0, 4.0, 0.5, 0.5, 0.3], SHARES, *[[0.2, 0.1, 0.1, 0.06, 0.1, 0.1]] * 4])
    links = chain.parameters.copy()
    links[5, 0] += carried
    planted = np.concatenate([links.ravel(), GEARED.model.truth()[60:-36], rubbing.ravel()])
    noise = np.random.default_rng(seed).normal(size=MOTION.q.shape) * SIGMA
    time = np.arange(len(MOTION.q)) * (20.0 / len(MOTION.q))
    return RobotLog(time, MOTION.q, GEARED.model.torque(MOTION, planted) + noise), MOTION


def test_gears_that_rub_by_load_are_found_and_what_they_carry_is_weighed_within_its_interval():
    assert used_arm() is BEFORE  # a make that is only looked at is not used
    found = identify_from_log(GEARED, *_geared_log(901))
    columns = [found.model.names.index(f"fl{joint}") for joint in range(1, 7)]
    at = np.searchsorted(found.base.columns, columns)
    assert np.all(np.abs(found.found.theta[at] - SHARES) < 3.5 * found.found.std[at])
    assert np.all(found.found.std[at[:3]] < 0.005)
    figures = found.figures
    assert np.all(np.array(figures["nrms_heldout"]) < np.array(figures["nrms_heldout_rigid"]))
    assert max(figures["residual_over_noise_heldout"]) < 1.1
    empty, loaded, carried = _geared_log(902), _geared_log(903, 2.8), 2.8
    figures = weigh_from_logs(GEARED, empty, loaded).figures
    assert abs(figures["payload_mass_kg"] - carried) < 3.0 * figures["payload_mass_std_kg"]


def _write(folder, table, names=NAMES):
    file = folder / "log.csv"
    np.savetxt(file, table, delimiter=",", header=",".join(names), comments="")
    return file


def _read(file, kinds=(HINGE,) * 6, period=None):
    """The log as `polish-sim identify` takes it."""
    gaps = {} if period is None else {"of_gap": None}
    return log_file.log_of(file, read_robot_recording(file, ("q_rad",), columns_of(kinds), **gaps), period)


@pytest.mark.parametrize(
    ("column", "values", "said"),
    [
        (0, TABLE[:, 0] * 10.0, r"samples are 0.1 s apart.* 50 samples a second"),
        (8, np.clip(TABLE[:, 8], -20.0, 20.0), r"torque of joint 2 stands at 20 in \d+%"),
        (9, 0.0, r"torque of joint 3 is 0 in every sample"),
    ],
)
def test_a_spoilt_log_is_refused(column, values, said, tmp_path):
    """What any reader of a log refuses is in tests/exchange/test_robot_log.py"""
    table = TABLE.copy()
    table[:, column] = values
    with pytest.raises(InputError, match=said):
        _read(_write(tmp_path, table))


def test_a_period_that_does_not_fit_the_log_is_refused_and_the_shortest_has_a_series(tmp_path):
    file = _write(tmp_path, TABLE)
    for period, said in ((0.01, "too few in a period"), (0.4, "0.41 or more"), (1e5, "less than one")):
        with pytest.raises(InputError, match=f"--period {period:g}: .*{said}"):
            _read(file, period=period)
    assert np.isfinite(log_file.periodic_states(_read(file, period=0.42), 0.42).qdd).all()


def test_logs_of_slides_of_coarse_steps_and_of_quantities_without_joints_are_read(tmp_path):
    table = TABLE.copy()
    table[:, 7:] = np.round(table[:, 7:] / 2.0) * 2.0
    assert np.mean(table[:, 8] == table[:, 8].max()) > 0.01
    log = _read(_write(tmp_path, table))
    np.testing.assert_allclose(log.torque, table[:, 7:])
    np.testing.assert_allclose(log.q, LOGGED.states.q)
    names = ["time_s", "q1_rad", "q2_m", "torque1_nm", "force2_n"]
    file = _write(tmp_path, TABLE[:, [0, 1, 2, 7, 8]] * [1.0, 1.0, 9.0, 1.0, 1.0], names)
    assert np.abs(_read(file, (HINGE, SLIDE)).q[:, 1]).max() > 7.0
    with pytest.raises(InputError, match="no column q2_rad for q_rad"):
        _read(file, (HINGE, HINGE))
    file = tmp_path / "log.npz"
    np.savez(file, time_s=TABLE[:, 0], q_rad=np.degrees(TABLE[:, 1:3]), torque_nm=TABLE[:, 7:9])
    (tmp_path / "map.toml").write_text("[units]\nq_rad = 'deg'\n")
    degrees = read_column_map(tmp_path / "map.toml", 2)._replace(wanted=columns_of((HINGE, HINGE)).wanted)
    read = log_file.log_of(file, read_robot_recording(file, ("q_rad",), degrees))
    np.testing.assert_allclose(read.q, TABLE[:, 1:3])
    np.testing.assert_array_equal(read.torque, TABLE[:, 7:9])
    with pytest.raises(InputError, match=r"q2_m for q_rad\..*--map"):
        _read(file, (HINGE, SLIDE))


def test_missing_columns_short_logs_other_joints_and_angles_that_are_all_missing_are_refused(tmp_path):
    with pytest.raises(InputError, match="no column torque5_nm, torque6_nm"):
        _read(_write(tmp_path, TABLE[:, :-2], NAMES[:-2]))
    with pytest.raises(InputError, match="holds 100 samples"):
        _read(_write(tmp_path, TABLE[:100]))
    file = _write(tmp_path, TABLE)
    joints = [*"abcdef", "pad"]
    with pytest.raises(InputError, match=r"of pad\. .* --joints a,b,c,d,e,f"):
        log_file.check_joints(file, "", (HINGE,) * 6 + (SLIDE,), joints)
    with pytest.raises(InputError, match="no column q7_m"):
        _read(file, (HINGE,) * 6 + (SLIDE,))
    table = TABLE.copy()
    table[:, 1:7] = np.nan
    with pytest.raises(InputError, match="q_rad, column 1, is nan"):
        use_states(_write(tmp_path, table))


def test_accelerations_are_those_of_the_motion_by_splines_and_by_periods_and_hardly_spoilt_by_gaps(tmp_path):
    table = np.delete(TABLE, slice(300, 380), axis=0)
    log = _read(_write(tmp_path, table), period=10.0)
    states = log_file.periodic_states(log, 10.0)
    assert np.abs(states.qdd - LOGGED.motion(log.time).qdd).max() < 1e-6
    lost = np.s_[500:509]  # 0.1 s of a log of 100 Hz
    log = _read(_write(tmp_path, np.delete(TABLE, lost, axis=0)))
    assert np.diff(log.time).max() == pytest.approx(0.1)
    logs = log, _read(_write(tmp_path, TABLE))
    off = [log_file.spline_states(one).qdd - LOGGED.motion(one.time).qdd for one in logs]
    near, usual = (np.abs(one[450:550]).max() for one in off)
    assert near < 2.0 * usual
    states = log_file.spline_states(log_file.RobotLog(TABLE[:, 0], LOGGED.states.q, LOGGED.torque), knots=0.1)
    assert np.abs(states.qdd - LOGGED.states.qdd)[20:-20].max() < 0.02
