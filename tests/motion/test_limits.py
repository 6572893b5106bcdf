"""Limits of tool and joints: defaults, units of the file, what is refused."""

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


def test_a_file_written_is_read_again_and_a_section_left_out_keeps_its_defaults(tmp_path):
    limits = replace(SmoothingLimits(), tip_jerk=7.0, joint_speed=(1.0, 2.0, 3.0, 3.0, 2.0, 1.0))
    again = load_limits(written(tmp_path, limits_toml(limits)))
    assert again.tip_jerk == pytest.approx(7.0)
    np.testing.assert_allclose(again.joint_speed, limits.joint_speed)
    text = "[joint]\nspeed_deg_s = 90\nacceleration_deg_s2 = 400\njerk_deg_s3 = [1, 2, 3, 4, 5, 6]\n"
    limits = load_limits(written(tmp_path, text))
    assert limits.joint_speed == pytest.approx((math.pi / 2,) * 6)  # one number for all joints
    assert limits.joint_jerk[5] == pytest.approx(math.radians(6.0))
    assert limits.tip_speed == 0.05


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[tip]\nspeed_mm_s = 50\njerk_mm_s3 = 1", "'tip.acceleration_mm_s2' is missing"),
        ("[tip]\nspeed_mm_s = 0\nacceleration_mm_s2 = 1\njerk_mm_s3 = 1", "'tip.speed_mm_s' .* positive"),
        ("[tip]\nspeed_mm_s = nan\nacceleration_mm_s2 = 1\njerk_mm_s3 = 1", "positive number, got nan"),
        ("[tip]\nspeed = 5", "unknown key 'tip.speed'"),
        ("speed = 5", "'speed' .* no section"),
        ("[joint]\nspeed_deg_s = [1, 2]\nacceleration_deg_s2 = 1\njerk_deg_s3 = 1", "one number or six"),
        ("[tip", "not valid TOML"),
    ],
)
def test_a_file_that_cannot_be_used_is_named(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message):
        load_limits(written(tmp_path, text))
    with pytest.raises(ConfigError, match="cannot read"):
        load_limits(tmp_path / "none.toml")


def test_limits_made_by_hand_must_be_positive():
    for name, bad in (("axis_jerk", -1.0), ("joint_speed", (1.0, 1, 1, 1, 1, 0))):
        with pytest.raises(ConfigError, match=name):
            replace(SmoothingLimits(), **{name: bad})  # type: ignore[arg-type]
