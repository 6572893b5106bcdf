"""Plant a tool and a sensor's bias, take readings, recover them; wrong readings are left out and named."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.calibration import (
    GRAVITY,
    PayloadReadings,
    fit_payload,
    fit_without_outliers,
    payload_regressor,
    plan_payload_poses,
    read_readings,
    residual_table,
)
from polish_sim.calibration.tables import MATRIX, QUATERNION, ROTATION_VECTOR, TIME, WRENCH
from polish_sim.errors import CalibrationError, InputError

MASS, CENTER = 2.0, np.array([0.002, -0.0013, 0.0896])
BIAS = np.array([1.5, -2.4, 2.9, 0.08, -0.05, 0.02])
THETA = np.concatenate([[MASS], MASS * CENTER, BIAS])
NOISE = np.repeat([0.05, 0.002], 3)
POSES = plan_payload_poses(12).R_base_sensor
PUSH, TWIST = np.array([0.0, 1.0, 0.0, 0, 0, 0]), np.array([0, 0, 0, 0.0, 0.0, 0.05])
HEADER, MATRICES = ",".join((*QUATERNION, *WRENCH)), ",".join((*MATRIX, *WRENCH))


def readings_in(R_base_sensor, theta=THETA, errors=0.0):
    """Newton at rest, one pose after the other, 3 s apart, written with cross products."""
    time = 3.0 * np.arange(len(R_base_sensor))
    up = R_base_sensor.transpose(0, 2, 1) @ [0.0, 0.0, 1.0]
    force = theta[0] * GRAVITY * up
    wrenches = np.concatenate([force, np.cross(theta[1:4] / theta[0], force)], axis=1) + theta[4:10]
    if len(theta) > 10:
        wrenches = wrenches + np.outer(time - time.mean(), theta[10:])
    return PayloadReadings(time, R_base_sensor.copy(), wrenches + errors)


@pytest.mark.parametrize("count", [3, 12, 200])
def test_exact_readings_give_tool_bias_and_drift(count):
    found = fit_without_outliers(readings_in(Rotation.random(count, random_state=count).as_matrix()))
    np.testing.assert_allclose(found.theta, THETA, atol=1e-9)
    np.testing.assert_allclose(found.center, CENTER, atol=1e-9)
    np.testing.assert_allclose(found.residuals, 0.0, atol=1e-9)
    assert found.used.all()
    drifting = np.concatenate([THETA, [0.003, -0.002, 0.001, 1e-4, -2e-4, 3e-4]])
    found = fit_payload(readings_in(POSES, drifting), drift=True)
    np.testing.assert_allclose(found.theta, drifting, atol=1e-9)


def test_over_many_draws_the_error_is_the_cramer_rao_bound_to_5_percent():
    """The noise is found from the residuals; 800 draws determine an rms to 2.5%."""
    rng = np.random.default_rng(4)
    found = [fit_payload(readings_in(POSES, errors=NOISE * rng.standard_normal((12, 6)))) for _ in range(800)]
    rows = (payload_regressor(POSES[:, 2, :]) / NOISE[:, None]).reshape(-1, 10)
    bound = np.linalg.inv(rows.T @ rows)
    ratio = np.sqrt(np.mean([(one.theta - THETA) ** 2 for one in found], axis=0) / np.diag(bound))
    assert ratio.min() > 0.95
    assert ratio.max() < 1.05
    assert np.mean([one.noise for one in found], axis=0) == pytest.approx(NOISE, rel=0.03)
    errors = ([one.mass - MASS, *(one.center - CENTER), *(one.bias - BIAS)] for one in found)
    score = np.array([*errors]) / [[one.mass_std, *one.center_std, *one.std[4:]] for one in found]
    np.testing.assert_allclose(score.std(axis=0), 1.0, atol=0.08)
    np.testing.assert_allclose(score.mean(axis=0), 0.0, atol=0.09)


def tilted(*angles):
    return Rotation.from_euler("xy", angles).as_matrix()


@pytest.mark.parametrize(
    ("R_base_sensor", "said"),
    [
        (np.eye(3)[None], "1 reading cannot"),
        (tilted((0.0, 0.0), (1.0, 0.0)), "2 readings cannot"),
        (tilted((0.0, 0.0), (0.01, 0.0), (0.0, 0.01)), "Turn the tool"),
        (tilted((0.0, 0.0), (0.0, 0.0), (1.5, 0.0), (1.5, 0.0)), "Add a pose"),
    ],
)
def test_poses_that_cannot_tell_say_what_is_missing(R_base_sensor, said):
    with pytest.raises(CalibrationError, match=said):
        fit_payload(readings_in(R_base_sensor))
    still = PayloadReadings(np.zeros(12), POSES.copy(), readings_in(POSES).wrenches.copy())
    with pytest.raises(CalibrationError, match="its time"):
        fit_payload(still, drift=True)


def knocked(rng, knocks):
    errors = NOISE * rng.standard_normal((12, 6))
    for reading, knock in knocks.items():
        errors[reading] += knock
    return readings_in(POSES, errors=errors)


@pytest.mark.parametrize("knocks", [{4: 1e6 * PUSH}, {0: PUSH, 7: TWIST}, {2: PUSH, 3: -PUSH, 11: TWIST}])
def test_touched_readings_are_left_out_and_named(knocks):
    found = [fit_without_outliers(knocked(np.random.default_rng(seed), knocks)) for seed in range(40)]
    right = [set(np.flatnonzero(~one.used)) == set(knocks) for one in found]
    assert np.mean(right) > 0.9
    assert max(abs(one.mass - MASS) for one, good in zip(found, right, strict=True) if good) < 0.01


def test_honest_readings_are_kept_of_a_few_all_and_where_too_many_disagree_nobody_is_believed():
    found = [fit_without_outliers(knocked(np.random.default_rng(seed), {})) for seed in range(150, 251)]
    assert np.mean([one.used.all() for one in found]) > 0.99
    first = knocked(np.random.default_rng(1), {0: PUSH})
    columns = first.time, first.R_base_sensor, first.wrenches
    assert fit_without_outliers(PayloadReadings(*(column[:6].copy() for column in columns))).used.all()
    rng = np.random.default_rng(0)
    knocks = {reading: rng.uniform(2.0, 9.0) * np.roll(PUSH, reading) for reading in range(5)}
    with pytest.raises(CalibrationError, match="more than 25% of the 12 readings"):
        fit_without_outliers(knocked(rng, knocks))


def test_every_way_to_write_an_orientation_gives_the_same_tool_and_what_we_write_we_read(tmp_path):
    """In any order of the columns, with others between them, and in capitals."""
    first, file, turns = readings_in(POSES), tmp_path / "readings.csv", Rotation.from_matrix(POSES)
    for form, turned in (
        (QUATERNION, turns.as_quat(scalar_first=True)),
        (ROTATION_VECTOR, turns.as_rotvec()),
        (MATRIX, POSES.reshape(-1, 9)),
    ):
        names = (*(name.upper() for name in WRENCH), "Temperature", *form, TIME)
        values = np.column_stack([first.wrenches, np.full(12, 21.0), turned, first.time])
        rows = [",".join(names), *(",".join(f"{value:.12g}" for value in row) for row in values)]
        file.write_text("# of our robot\n\n" + "\n".join(rows) + "\n", encoding="utf-8")
        np.testing.assert_allclose(fit_payload(read_readings(file)).theta, THETA, atol=1e-8)
    first = readings_in(POSES, errors=NOISE * np.random.default_rng(0).standard_normal((12, 6)))
    found = fit_without_outliers(first)
    file.write_text(residual_table(first, found, np.zeros((12, 6))), encoding="utf-8")
    again = fit_without_outliers(read_readings(file))
    np.testing.assert_allclose(again.theta, found.theta, atol=1e-7)
    np.testing.assert_allclose(again.residuals, found.residuals, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEADER + "\n", "no readings"),
        ("qw,qx,qy,qz,fx_n,fy_n,fz_n,tx_nm,ty_nm\n1,0,0,0,1,2,3,4,5\n", "tz_nm"),
        ("fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm\n1,2,3,4,5,6\n", "rx_rad"),
        (HEADER + "\n1,0,0,0,1,2,3,4,5,6\n1,0,0,0,1,2,nan,4,5,6\n", "line 3: fz_n is 'nan'"),
        (HEADER + "\n\n1,0,0,0,1,2,3 N,4,5,6\n", "line 3: fz_n is '3 N'"),
        (HEADER + "\n1,0,0,0,1,2,3,4,5\n", "line 2: 9 values"),
        (HEADER + "\n0,0,0,0,1,2,3,4,5,6\n", "line 2: qw to qz"),
        (MATRICES + "\n1,0,0,0,1,0,0,0,1.1,1,2,3,4,5,6\n", "line 2: r11 to r33.*orthonormal"),
        (MATRICES + "\n1,0,0,0,1,0,0,0,-1,1,2,3,4,5,6\n", "line 2: r11 to r33.*right-handed"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, said):
    file = tmp_path / "readings.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said):
        read_readings(file)
