"""How a stroke may be followed in the cell: every rule keeps its own promise."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from polish_sim.config import Scenario
from polish_sim.errors import InputError, PolishSimError, SmoothingError
from polish_sim.experiments.stroke_motion import STROKE_RULES, StrokePath, stroke_motion, within_noise
from polish_sim.experiments.surface import prepare_surface
from polish_sim.geometry.repair.skin import NOISELESS, Noise
from polish_sim.motion.timed_path import TimedPath
from polish_sim.spatial import rotation_to_axis

FEED = 0.06


def test_a_stroke_over_noisy_normals_keeps_the_feed_within_their_noise() -> None:
    """Normals that jitter by 1 deg every 2.4 mm: within 0.2 deg they cost speed, within their own noise hardly any."""
    rng, s = np.random.default_rng(1), np.linspace(0.0, 0.1, 201)
    knots = np.linspace(0.0, 0.1, 42)
    tilt = np.stack([np.interp(s, knots, math.radians(1.0) * rng.normal(size=42)) for _ in range(2)], axis=1)
    axes = -np.column_stack([tilt, np.ones(201)]) / np.sqrt(1.0 + np.sum(tilt**2, axis=1))[:, None]
    stroke = StrokePath(np.outer(s, [1.0, 0, 0]), rotation_to_axis(axes, np.array([1.0, 0, 0])), s, np.full(201, 0.02))
    times = []
    for noise in (NOISELESS, Noise(5e-5, math.radians(1.0))):
        motion = stroke_motion(within_noise(Scenario(), noise), stroke, None)
        assert motion is not None
        times.append(motion.duration)
    assert within_noise(Scenario(), NOISELESS) == Scenario()
    least = 0.1 / 0.02  # at the feed
    assert times[1] - least < (times[0] - least) / 3.0


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
