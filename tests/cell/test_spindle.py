"""The pull of an unbalanced spindle: its size and turning, what the sensor makes of it, and when it runs down."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polish_sim.cell import CellRun
from polish_sim.cell.contact import RUN_DOWN_S, build_spindle, pull_of_imbalance, turn_spindle
from polish_sim.config import SpindleConfig
from tests.cell.cells import EVERY_STEP, cell_for, ideal, part_under, pressing_stroke
from tests.cell.fields import plane
from tests.cell.pressing import Array

G63 = 0.3 * 0.0063 * 2.0 * math.pi * 100.0  # m e omega^2 of 0.3 kg at G6.3 and 6000 1/min [N]


def pulls(config: SpindleConfig, steps: int, dt: float = 1e-3) -> Array:
    """Pull on an upright head at every step, shape (steps, 3)."""
    spindle, found = build_spindle(config), np.zeros((steps, 3))
    for row in found:
        turn_spindle(spindle, dt)
        pull_of_imbalance(spindle, np.eye(3).ravel(), row)
    return found


def test_g63_at_6000_per_minute_pulls_1_2_newton_once_round_in_10_ms() -> None:
    found = pulls(SpindleConfig(), 200)
    assert pytest.approx(1.19, abs=0.005) == G63
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), G63, rtol=1e-12)
    np.testing.assert_allclose(found[10:], found[:-10], atol=1e-12)
    np.testing.assert_allclose(found[5:], -found[:-5], atol=1e-12)
    np.testing.assert_array_equal(found[:, 2], 0.0)


def test_a_spindle_that_stands_or_is_balanced_does_not_pull() -> None:
    for config in (SpindleConfig(speed_rpm=0.0), SpindleConfig(imbalance_m_s=0.0)):
        np.testing.assert_array_equal(pulls(config, 20), 0.0)


def test_without_its_drive_it_runs_down_evenly_and_the_pull_falls_with_the_square_of_its_speed() -> None:
    spindle = build_spindle(SpindleConfig())
    spindle.failed = True
    for _ in range(round(0.5 * RUN_DOWN_S / 1e-3)):
        turn_spindle(spindle, 1e-3)
    assert spindle.speed == pytest.approx(0.5 * spindle.commanded)
    force = np.zeros(3)
    pull_of_imbalance(spindle, np.eye(3).ravel(), force)
    assert np.linalg.norm(force) == pytest.approx(0.25 * G63)
    for _ in range(300):
        turn_spindle(spindle, 1e-3)
    assert spindle.speed == 0.0


def pressing(*changes: str) -> CellRun:
    scenario = ideal("force", EVERY_STEP, "spindle.speed_rpm=6000", *changes)
    return cell_for(scenario, pressing_stroke(hold=1.2), part=part_under(plane())).run()


def line(signal: Array, frequency: float) -> float:
    """Amplitude of a frequency [Hz] in a signal over whole periods of it."""
    time = 1e-3 * np.arange(len(signal))
    return float(2.0 * abs(np.mean((signal - signal.mean()) * np.exp(-2j * np.pi * frequency * time))))


@pytest.fixture(scope="module")
def slow() -> CellRun:
    """Pressing with the spindle on; the sensor takes 125 samples a second."""
    return pressing("sensor.rate_hz=125")


def test_a_sensor_of_125_hz_sees_the_spindles_100_hz_as_25_hz(slow: CellRun) -> None:
    held = slow.log["wrench_measured_tool"][-400:, :2].astype(float)
    exact = slow.log["wrench_raw_sensor"][-400:, :2].astype(float)
    for axis in range(2):
        felt = line(exact[:, axis], 100.0)
        assert felt > 0.2
        assert line(exact[:, axis], 25.0) < 0.06 * felt
        # The reading is held for 8 ms, which takes sinc(25 * 0.008) of it; the low-pass leaves 98% of a new sample.
        assert line(held[:, axis], 25.0) == pytest.approx(felt * np.sinc(25.0 * 0.008), rel=0.08)


def test_a_sensor_of_1_khz_sees_it_as_it_is(slow: CellRun) -> None:
    run = pressing("sensor.bandwidth_hz=0")
    held, exact = run.log["wrench_measured_tool"][-400:, 0], run.log["wrench_raw_sensor"][-400:, 0]
    assert line(held, 25.0) < 0.02
    assert line(held, 100.0) == pytest.approx(line(exact, 100.0), rel=0.01)


def test_the_pull_moves_the_tool_sideways_and_leaves_the_pressing_force(slow: CellRun) -> None:
    quiet = pressing("sensor.rate_hz=125", "spindle.imbalance_m_s=0")
    assert np.abs(slow.trace.normal_force_n[-400:] - quiet.trace.normal_force_n[-400:]).max() < 0.2
