"""The scenario as pure data: every field says what it means and lies within its own range."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import Field, FrozenInstanceError, fields, is_dataclass
from typing import Any

import pytest

from polish_sim.config import Scenario
from polish_sim.errors import InputError
from polish_sim.experiments.registry import ROWS, default_scenario


def leaves(table: Any, place: str = "") -> Iterator[tuple[str, Any, Field[Any]]]:
    """Every key of a scenario by its dotted name, with its value and its field."""
    for f in fields(table):
        value = getattr(table, f.name)
        if is_dataclass(value):
            yield from leaves(value, f"{place}{f.name}.")
        else:
            yield f"{place}{f.name}", value, f


@pytest.mark.parametrize("name", sorted(ROWS))
def test_every_default_lies_within_its_range(name: str) -> None:
    for key, value, field in leaves(default_scenario(name)):
        if isinstance(value, (int, float)):
            assert field.metadata["low"] <= value <= field.metadata["high"], key


UNITS = {
    "_m": "[m]", "_n": "[N]", "_s": "[s]", "_hz": "[Hz]", "_kg": "[kg]", "_rad": "[rad]", "_nm": "[N m]",
    "_m_s": "[m/s]", "_m_s2": "[m/s^2]", "_rad_s": "[rad/s]", "_rad_s2": "[rad/s^2]", "_n_m": "[N/m]",
    "_n_s_m": "[N s/m]", "_s_m": "[s/m]", "_rpm": "[1/min]", "_m_sn": "[m/(s N)]", "_m_s2n": "[m/(s^2 N)]",
    "_rad_snm": "[rad/(s N m)]", "_rad_s2nm": "[rad/(s^2 N m)]", "_n_s": "[N/sqrt(s)]", "_nm_s": "[N m/sqrt(s)]",
    "_1_pa": "[1/Pa]", "_j": "[J]", "_nm_rad": "[N m/rad]", "_nm_s_rad": "[N m s/rad]",
    "_kg_m3": "[kg/m^3]",
}  # fmt: skip
OTHER_UNITS = {
    "controller.orientation_i_hz": "[1/s]",
    "controller.position_rate_p": "[1/s]",
    "controller.adaptive.force_rate_n_s": "[N/s]",
    "controller.adaptive.normal_rate_1_s": "[1/s]",
}


def test_a_keys_last_letters_and_its_meaning_name_the_same_unit() -> None:
    for key, value, field in leaves(Scenario()):
        if not isinstance(value, float):
            continue
        endings = [ending for ending in UNITS if key.endswith(ending)]
        unit = OTHER_UNITS.get(key, UNITS[max(endings, key=len)] if endings else "[-]")
        said = field.metadata["text"]
        assert unit in said or (unit == "[-]" and "[" not in said), key


def test_a_scenario_cannot_be_changed_after_it_was_made() -> None:
    with pytest.raises(FrozenInstanceError):
        Scenario().seed = 1  # type: ignore[misc]


def test_an_unknown_experiment_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"'polish'.*arc, dual, force, smooth, surface, teach"):
        default_scenario("polish")


def test_head_and_pad_in_series_are_the_papers_5000_newton_per_metre() -> None:
    scenario = Scenario()
    assert 1.0 / (1.0 / scenario.head.stiffness_n_m + 1.0 / scenario.pad.stiffness_n_m) == pytest.approx(5000.0)


def test_the_default_latency_is_two_milliseconds_of_sensor_and_six_of_command() -> None:
    scenario = Scenario()
    assert (scenario.sensor.latency_s, scenario.robot.command_latency_s) == (0.002, 0.006)
