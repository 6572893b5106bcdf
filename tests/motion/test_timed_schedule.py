"""A schedule sampled densely is the schedule: poses, rates, and how far along the path it has come."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.motion.rules.chain import Chain, build_chain
from polish_sim.motion.rules.fir import fir_schedule
from polish_sim.motion.rules.schedule import Schedule, sample_schedule, stretched
from polish_sim.motion.timed_path import marks_on, places_at, sample_motion, time_schedule

Array = NDArray[np.float64]
TIPS = np.array([[0.0, 0, 0], [0.02, 0, 0], [0.02, 0, 0], [0.03, 0.02, 0], [0.05, 0.02, 0.01]])
ROTATIONS = Rotation.from_rotvec(0.1 * np.outer(np.arange(5), [1.0, 0.5, 0.2])).as_matrix()
ROTATIONS[2] = ROTATIONS[1]  # point 2 repeats point 1
S = np.array([0.0, 0.02, 0.02, 0.045, 0.07])


def overlapping() -> tuple[Chain, Schedule]:
    chain = build_chain(TIPS, ROTATIONS)
    return chain, fir_schedule(np.array([0.0, 0.5, 1.1]), np.tile([0.5, 0.1, 0.05], (3, 1)))


def test_marks_are_those_of_the_points_the_chain_kept() -> None:
    chain, _ = overlapping()
    np.testing.assert_array_equal(marks_on(chain, TIPS, ROTATIONS, S), [0.0, 0.02, 0.045, 0.07])


def test_between_its_rows_it_is_where_the_schedule_is() -> None:
    chain, schedule = overlapping()
    motion = time_schedule(chain, schedule, np.array([0.0, 0.02, 0.045, 0.07]))
    clock = np.linspace(0.0, schedule.end, 400)
    exact = sample_schedule(chain, schedule, clock)
    position, velocity, spin, quaternion, place = np.empty(3), np.empty(3), np.empty(3), np.empty(4), np.empty(2)
    for i, t in enumerate(clock):
        sample_motion(motion, float(t), position, velocity, quaternion, spin, place)
        np.testing.assert_allclose(position, exact.tips[i, 0], atol=2e-8)
        np.testing.assert_allclose(velocity, exact.tips[i, 1], atol=3e-5)
        np.testing.assert_allclose(spin, exact.spins[i, 0], atol=2e-3)
        R = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        np.testing.assert_allclose(R, exact.rotations[i], atol=3e-5)


def test_the_place_runs_from_the_first_mark_to_the_last_and_its_rate_is_its_derivative() -> None:
    chain, schedule = overlapping()
    marks = np.array([0.0, 0.02, 0.045, 0.07])
    motion = time_schedule(chain, schedule, marks)
    assert motion.places[0] == 0.0
    assert motion.places[-1] == pytest.approx(0.07, abs=1e-12)
    assert np.all(np.diff(motion.places) >= 0.0)
    rate = np.gradient(motion.places, motion.spacing)
    np.testing.assert_allclose(motion.speeds[1:-1], rate[1:-1], atol=2e-4)
    clock = np.arange(len(motion.places)) * motion.spacing
    np.testing.assert_allclose(places_at(chain, schedule, marks, clock), motion.places, atol=1e-12)


def test_in_twice_the_time_speeds_halve_and_the_way_stays() -> None:
    chain, schedule = overlapping()
    slow = stretched(schedule, 2.0)
    clock = np.linspace(0.0, schedule.end, 300)
    fast_run, slow_run = sample_schedule(chain, schedule, clock), sample_schedule(chain, slow, 2.0 * clock)
    assert slow.end == pytest.approx(2.0 * schedule.end)
    for order, factor in enumerate((1.0, 2.0, 4.0, 8.0)):
        np.testing.assert_allclose(factor * slow_run.tips[:, order], fast_run.tips[:, order], atol=1e-9 * 10.0**order)
