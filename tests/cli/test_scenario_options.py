"""Options in mm, deg, N and mm/s reach the scenario in SI, and say what is wrong in the user's words."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from polish_sim.cli.scenario_options import build_scenario, parse_log_rate, parse_pose
from polish_sim.config import Scenario
from polish_sim.errors import ConfigError, PolishSimError


def test_every_option_lands_in_its_key_in_si() -> None:
    given = {
        "--part": "plate",
        "--part-pose": "-100,-500,50,0,0,90",
        "--contact-force": 15.0,
        "--feed": 12.0,
        "--pad-diameter": 30.0,
        "--spindle-rpm": 3000.0,
        "--stepover": 5.0,
        "--seed": 4,
        "--log-rate": "full",
    }
    scenario = build_scenario(Scenario(), given, None, [])
    assert scenario.part.file == "plate"
    assert scenario.part.pose == pytest.approx((-0.1, -0.5, 0.05, 0.0, 0.0, math.pi / 2))
    assert scenario.process.contact_force_n == 15.0
    assert scenario.process.feed_m_s == pytest.approx(0.012)
    assert scenario.pad.radius_m == pytest.approx(0.015)
    assert scenario.spindle.speed_rpm == 3000.0
    assert scenario.plan.stepover_m == pytest.approx(0.005)
    assert scenario.seed == 4
    assert scenario.simulation.log_rate_hz == 0.0


def test_options_that_were_not_given_change_nothing() -> None:
    assert build_scenario(Scenario(), {"--feed": None, "--part": None}, None, []) == Scenario()


def test_set_beats_options_and_options_beat_the_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[process]\nfeed_m_s = 0.002\ncontact_force_n = 5.0\n[pad]\npoints = 50\n")
    scenario = build_scenario(
        Scenario(), {"--feed": 3.0, "--contact-force": 6.0}, file, ["process.contact_force_n=7.0"]
    )
    assert scenario.pad.points == 50
    assert scenario.process.feed_m_s == pytest.approx(0.003)
    assert scenario.process.contact_force_n == 7.0


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--stepover", -3.0, r"--stepover -3.*plan\.stepover_m"),
        ("--feed", math.nan, r"--feed nan"),
        ("--contact-force", -20.0, r"--contact-force -20"),
        ("--part-pose", "1,2,3", r"six numbers in mm and deg"),
        ("--part-pose", "a,b,c,d,e,f", r"six numbers"),
        ("--part-pose", "1,2,3,4,5,nan", r"six numbers"),
        ("--log-rate", "fast", r"'fast' is neither"),
        ("--log-rate", "-1", r"'-1' is neither"),
    ],
)
def test_a_bad_value_is_named_with_its_option(option: str, value: Any, said: str) -> None:
    with pytest.raises(PolishSimError, match=said):
        build_scenario(Scenario(), {option: value}, None, [])


def test_a_file_for_another_experiment_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "arc.toml"
    file.write_text('experiment = "arc"\n')
    with pytest.raises(ConfigError, match=r"'arc', not 'surface'"):
        build_scenario(Scenario(), {}, file, [])


def test_poses_and_rates_are_read_as_written() -> None:
    assert parse_pose("0,0,1000,180,0,0") == pytest.approx([0.0, 0.0, 1.0, math.pi, 0.0, 0.0])
    assert parse_log_rate("500") == 500.0
