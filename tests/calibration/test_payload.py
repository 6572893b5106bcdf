"""Plant a tool and a bias, recover them: exactly without noise, as well as can be with it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.calibration import (
    GRAVITY,
    PayloadReadings,
    fit_payload,
    payload_regressor,
    plan_payload_poses,
)
from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

MASS, CENTER = 2.0, np.array([0.002, -0.0013, 0.0896])
BIAS = np.array([1.5, -2.4, 2.9, 0.08, -0.05, 0.02])
THETA = np.concatenate([[MASS], MASS * CENTER, BIAS])
NOISE = np.repeat([0.05, 0.002], 3)
DRIFT = np.array([0.003, -0.002, 0.001, 1e-4, -2e-4, 3e-4])
POSES = plan_payload_poses(12).R_base_sensor


def readings_in(R_base_sensor: Array, theta: Array = THETA, errors: Array | float = 0.0) -> PayloadReadings:
    """Newton at rest, one pose after the other, 3 s apart, written with cross products."""
    time = 3.0 * np.arange(len(R_base_sensor))
    up = R_base_sensor.transpose(0, 2, 1) @ [0.0, 0.0, 1.0]
    force = theta[0] * GRAVITY * up
    wrenches = np.concatenate([force, np.cross(theta[1:4] / theta[0], force)], axis=1) + theta[4:10]
    if len(theta) > 10:
        wrenches = wrenches + np.outer(time - time.mean(), theta[10:])
    return PayloadReadings(time, R_base_sensor.copy(), wrenches + errors)


@pytest.mark.parametrize("count", [3, 4, 12, 200])
def test_exact_readings_in_random_poses_give_the_tool_and_the_bias(count: int) -> None:
    found = fit_payload(readings_in(Rotation.random(count, random_state=count).as_matrix()))
    np.testing.assert_allclose(found.theta, THETA, atol=1e-9)
    np.testing.assert_allclose(found.center, CENTER, atol=1e-9)
    np.testing.assert_allclose(found.residuals, 0.0, atol=1e-9)
    assert found.used.all()


def test_exact_readings_of_a_drifting_sensor_give_the_drift_too() -> None:
    found = fit_payload(readings_in(POSES, np.concatenate([THETA, DRIFT])), drift=True)
    np.testing.assert_allclose(found.theta[:10], THETA, atol=1e-9)
    np.testing.assert_allclose(found.drift, DRIFT, atol=1e-9)


def test_over_many_draws_the_error_is_the_cramer_rao_bound_to_5_percent() -> None:
    """The noise is found from the residuals; 1500 draws tell an rms to 1.8%."""
    rng = np.random.default_rng(4)
    found = [fit_payload(readings_in(POSES, errors=NOISE * rng.standard_normal((12, 6)))) for _ in range(1500)]
    rows = (payload_regressor(POSES[:, 2, :]) / NOISE[:, None]).reshape(-1, 10)
    bound = np.linalg.inv(rows.T @ rows)
    ratio = np.sqrt(np.mean([(one.theta - THETA) ** 2 for one in found], axis=0) / np.diag(bound))
    assert ratio.min() > 0.95
    assert ratio.max() < 1.05
    assert np.mean([one.noise for one in found], axis=0) == pytest.approx(NOISE, rel=0.03)
    slope = np.column_stack([-CENTER, np.eye(3)]) / MASS
    center_bound = np.sqrt(np.diag(slope @ bound[:4, :4] @ slope.T))
    centers = np.array([one.center - CENTER for one in found])
    np.testing.assert_allclose(np.sqrt(np.mean(centers**2, axis=0)) / center_bound, 1.0, atol=0.05)
    for score in (
        np.array([(one.mass - MASS) / one.mass_std for one in found]),
        np.array([(one.center - CENTER) / one.center_std for one in found]),
        np.array([(one.bias - BIAS) / one.bias_std for one in found]),
    ):
        np.testing.assert_allclose(score.std(axis=0), 1.0, atol=0.08)
        np.testing.assert_allclose(score.mean(axis=0), 0.0, atol=0.09)


def test_turning_the_world_about_gravity_changes_nothing() -> None:
    errors = NOISE * np.random.default_rng(6).standard_normal((12, 6))
    turn = Rotation.from_rotvec([0.0, 0.0, 1.1]).as_matrix()
    here, there = fit_payload(readings_in(POSES, errors=errors)), fit_payload(readings_in(turn @ POSES, errors=errors))
    np.testing.assert_allclose(there.theta, here.theta, atol=1e-12)


def test_turning_the_sensor_turns_centre_and_bias_with_it() -> None:
    turn = Rotation.from_rotvec([0.4, -1.0, 0.3]).as_matrix()  # R_turned_sensor
    noise = np.random.default_rng(7).standard_normal((12, 2, 3)) * np.array([[0.05], [0.002]])
    first = readings_in(POSES, errors=noise.reshape(12, 6))
    turned = (first.wrenches.reshape(12, 2, 3) @ turn.T).reshape(12, 6)
    here = fit_payload(first)
    there = fit_payload(PayloadReadings(first.time.copy(), first.R_base_sensor @ turn.T, turned))
    assert there.mass == pytest.approx(here.mass, rel=1e-9)
    np.testing.assert_allclose(there.center, turn @ here.center, atol=1e-10)
    np.testing.assert_allclose(there.bias.reshape(2, 3), here.bias.reshape(2, 3) @ turn.T, atol=1e-9)


def tilted(*angles: tuple[float, float]) -> Array:
    return Rotation.from_euler("xy", angles).as_matrix()


@pytest.mark.parametrize(
    ("R_base_sensor", "said"),
    [
        (np.eye(3)[None], "1 reading cannot tell mass, centre and bias"),
        (tilted((0.0, 0.0), (1.0, 0.0)), "2 readings cannot tell"),
        (Rotation.from_euler("z", [[0.0], [1.0], [2.0], [3.0]]).as_matrix(), "nearly the same direction"),
        (tilted((0.0, 0.0), (0.01, 0.0), (0.0, 0.01)), "nearly the same direction.*Turn the tool"),
        (tilted((0.0, 0.0), (0.0, 0.0), (1.5, 0.0), (1.5, 0.0)), "along one line of the sensor only.*Add a pose"),
    ],
)
def test_poses_that_cannot_tell_say_what_is_missing(R_base_sensor: Array, said: str) -> None:
    with pytest.raises(CalibrationError, match=said):
        fit_payload(readings_in(R_base_sensor))


def test_readings_without_their_times_cannot_show_a_drift() -> None:
    still = readings_in(POSES)
    with pytest.raises(CalibrationError, match=r"cannot tell the drift.*its time"):
        fit_payload(PayloadReadings(np.zeros(12), POSES.copy(), still.wrenches.copy()), drift=True)


def test_readings_of_the_opposite_sign_are_named() -> None:
    first = readings_in(POSES)
    with pytest.raises(CalibrationError, match="opposite sign"):
        fit_payload(PayloadReadings(first.time.copy(), POSES.copy(), -first.wrenches))


def test_a_mirror_is_no_orientation() -> None:
    mirrored = POSES.copy()
    mirrored[2] = -mirrored[2]
    with pytest.raises(CalibrationError, match="reading 3 is not a rotation"):
        PayloadReadings(np.zeros(12), mirrored, np.zeros((12, 6)))
