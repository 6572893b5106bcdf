"""How a stroke may be followed in the cell: every rule keeps its own promise."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from polish_sim.config import Scenario
from polish_sim.errors import InputError, PolishSimError, SmoothingError
from polish_sim.experiments.stroke_motion import STROKE_RULES, StrokePath, stroke_motion
from polish_sim.experiments.surface import prepare_surface
from polish_sim.motion.timed_path import TimedPath

FEED = 0.06


def bend(radius: float) -> StrokePath:
    """A straight line, half a circle and a straight line, sampled every half millimetre."""
    line, arc = np.arange(0.0, 0.05, 5e-4), np.linspace(0.0, math.pi, int(math.pi * radius / 5e-4))
    x = np.concatenate([line - 0.05, radius * np.sin(arc), -line - 5e-4])
    y = np.concatenate([0.0 * line, radius * (1.0 - np.cos(arc)), 0.0 * line + 2.0 * radius])
    tips = np.stack([x, y, 0.0 * x], axis=1)
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tips, axis=0), axis=1))])
    return StrokePath(tips, np.tile(np.eye(3), (len(x), 1, 1)), s, np.full(len(x), FEED))


def follow(rule: str, radius: float, **smoothing: float) -> TimedPath:
    scenario = Scenario()
    asked = replace(scenario.smoothing, rule=rule, **smoothing)  # type: ignore[arg-type]
    motion = stroke_motion(replace(scenario, smoothing=asked), bend(radius), None)
    assert motion is not None
    return motion


def test_by_a_spline_a_gentle_bend_is_passed_at_the_feed() -> None:
    motion = follow("spline", 0.025)
    inner = (motion.places > 0.01) & (motion.places < motion.places[-1] - 0.01)
    np.testing.assert_allclose(motion.speeds[inner], FEED, rtol=1e-3)


def test_by_a_spline_a_sharp_bend_is_passed_as_fast_as_its_acceleration_allows() -> None:
    motion = follow("spline", 0.003)
    best = math.sqrt(0.6 * 0.003)
    slowest = motion.speeds[(motion.places > 0.045) & (motion.places < 0.065)].min()
    assert 0.85 * best <= slowest <= 1.05 * best  # the tolerance lets the bend be a little wider than 3 mm
    acceleration = np.linalg.norm(np.gradient(motion.velocities, motion.spacing, axis=0), axis=1)
    assert acceleration.max() <= 0.6 * 1.01


def test_without_a_rule_the_feed_is_kept_whatever_it_takes() -> None:
    motion = follow("none", 0.003)
    acceleration = np.linalg.norm(np.gradient(motion.velocities, motion.spacing, axis=0), axis=1)
    assert acceleration.max() == pytest.approx(FEED**2 / 0.003, rel=0.2)


def test_a_rule_nobody_knows_is_refused_with_those_that_are_known() -> None:
    with pytest.raises(InputError, match="spline") as refused:
        follow("splines", 0.025)
    assert all(name in str(refused.value) for name in STROKE_RULES)


def test_a_spline_cannot_be_asked_for_exact_corners() -> None:
    with pytest.raises(SmoothingError, match="certified"):
        follow("spline", 0.025, tolerance_m=0.0)


@pytest.mark.parametrize("wrong", [{"rule": "splines"}, {"tolerance_m": 0.0}, {"limits_file": "none.toml"}])
def test_settings_of_smoothing_are_refused_before_the_part_is_looked_at(wrong: dict[str, Any]) -> None:
    scenario = Scenario()
    scenario = replace(
        scenario, part=replace(scenario.part, file="none.stl"), smoothing=replace(scenario.smoothing, **wrong)
    )
    with pytest.raises(PolishSimError, match=r"smoothing|limits"):
        prepare_surface(scenario)
