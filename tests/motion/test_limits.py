"""Limits of tool and joints: defaults, units of the file, what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from polish_sim.errors import ConfigError
from polish_sim.motion.rules.limits import SmoothingLimits, limits_toml, load_limits


def written(folder: Path, text: str) -> Path:
    (folder / "limits.toml").write_text(text, encoding="utf-8")
    return folder / "limits.toml"


def test_defaults_are_those_of_the_paper_s_trial() -> None:
    limits = SmoothingLimits()
    assert (limits.tip_speed, limits.tip_acceleration, limits.tip_jerk) == pytest.approx((0.05, 0.5, 10.0))
    assert limits.axis_jerk == pytest.approx(math.radians(2000.0))
    assert limits.values().joint[:, 5] == pytest.approx([math.pi, 5.0, 100.0])


def test_a_file_written_is_read_back(tmp_path: Path) -> None:
    limits = replace(SmoothingLimits(), tip_jerk=7.0, joint_speed=(1.0, 2.0, 3.0, 3.0, 2.0, 1.0))
    again = load_limits(written(tmp_path, limits_toml(limits)))
    assert again.tip_jerk == pytest.approx(7.0)
    np.testing.assert_allclose(again.joint_speed, limits.joint_speed)


def test_a_section_left_out_keeps_its_defaults_and_one_number_serves_all_joints(tmp_path: Path) -> None:
    text = "[joint]\nspeed_deg_s = 90\nacceleration_deg_s2 = 400\njerk_deg_s3 = [1, 2, 3, 4, 5, 6]\n"
    limits = load_limits(written(tmp_path, text))
    assert limits.joint_speed == pytest.approx((math.pi / 2,) * 6)
    assert limits.joint_jerk[5] == pytest.approx(math.radians(6.0))
    assert limits.tip_speed == 0.05


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[tip]\nspeed_mm_s = 50\njerk_mm_s3 = 1", "'tip.acceleration_mm_s2' is missing"),
        ("[tip]\nspeed_mm_s = 0\nacceleration_mm_s2 = 1\njerk_mm_s3 = 1", "'tip.speed_mm_s' .* positive"),
        ("[tip]\nspeed_mm_s = -5\nacceleration_mm_s2 = 1\njerk_mm_s3 = 1", "positive number, got -5"),
        ("[tip]\nspeed_mm_s = nan\nacceleration_mm_s2 = 1\njerk_mm_s3 = 1", "positive number, got nan"),
        ("[tip]\nspeed = 5", "unknown key 'tip.speed'"),
        ("[wrist]\nspeed = 5", "'wrist' .* no section"),
        ("speed = 5", "'speed' .* no section"),
        ("[joint]\nspeed_deg_s = [1, 2]\nacceleration_deg_s2 = 1\njerk_deg_s3 = 1", "one number or six"),
        ("[tip", "not valid TOML"),
    ],
)
def test_a_file_that_cannot_be_used_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_limits(written(tmp_path, text))


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot read"):
        load_limits(tmp_path / "none.toml")


@pytest.mark.parametrize(
    "bad", [{"tip_speed": 0.0}, {"axis_jerk": -1.0}, {"joint_speed": (1.0, 1, 1, 1, 1, 0)}]
)
def test_limits_made_by_hand_must_be_positive(bad: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(bad))):
        replace(SmoothingLimits(), **bad)
