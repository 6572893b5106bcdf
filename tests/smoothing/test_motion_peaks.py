"""Peaks of a smoothed motion: known truths, and no ghosts where pieces meet."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.motion.rules.chain import chain_from_axes
from polish_sim.motion.rules.fir import fir_schedule
from polish_sim.motion.rules.schedule import Schedule
from polish_sim.smoothing.figures import find_peaks, stretch_times

DOWN = np.array([0.0, 0.0, -1.0])
TIMES = np.array([[2.0, 0.5, 0.1]])


def corner(starts: list[float]) -> tuple[object, Schedule]:
    """100 mm along x, then 100 mm along y, each a box of 2 s filtered by 0.5 and 0.1 s."""
    chain = chain_from_axes(np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0]]), np.tile(DOWN, (3, 1)))
    return chain, fir_schedule(np.array(starts), np.repeat(TIMES, 2, axis=0))


def test_a_filtered_box_has_the_peaks_of_its_closed_form() -> None:
    peaks = find_peaks(*corner([0.0, 2.6]), None)
    assert [peak.value for peak in peaks.tip] == pytest.approx([0.05, 0.1, 1.0], rel=1e-6)
    assert [peak.value for peak in peaks.axis] == pytest.approx([0.0, 0.0, 0.0])
    assert peaks.joints == ()


def test_overlapping_segments_add_their_jerks() -> None:
    # For 0.1 s the last ramp of the old segment and the first one of the new, square to it, are one.
    peaks = find_peaks(*corner([0.0, 2.5]), None)
    assert peaks.tip[2].value == pytest.approx(np.sqrt(2.0), rel=1e-9)
    assert 2.5 < peaks.tip[2].time < 2.6


@pytest.mark.parametrize("overlap", [1e-15, 1e-12, 4e-11])
def test_segments_that_overlap_by_rounding_only_do_not(overlap: float) -> None:
    assert find_peaks(*corner([0.0, 2.6 - overlap]), None).tip[2].value == pytest.approx(1.0, rel=1e-9)


def test_times_rise_and_fill_every_stretch() -> None:
    _, schedule = corner([0.0, 2.6])
    times = np.concatenate(list(stretch_times(schedule)))
    assert np.all(np.diff(times) > 0.0)
    assert np.diff(times).max() <= 0.01 + 1e-12
    assert times[0] == pytest.approx(0.0, abs=1e-7)
    assert times[-1] == pytest.approx(schedule.end, abs=1e-7)
