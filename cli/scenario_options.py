"""From the command line's units (mm, deg, N, mm/s) to a scenario in SI: the one place where the two meet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from polish_sim.config import Scenario
from polish_sim.errors import ConfigError, InputError
from polish_sim.scenario_file import load_scenario, merge, override

MM: Final = 1e-3
DEG: Final = math.pi / 180.0


class Target(NamedTuple):
    """The key of the scenario an option sets, and what one of its unit is in SI."""

    section: str
    key: str
    unit: float | None = None


OPTIONS: Final[Mapping[str, Target]] = {
    "--part": Target("part", "file"),
    "--units": Target("part", "unit"),
    "--up": Target("part", "up"),
    "--region": Target("plan", "region"),
    "--pattern": Target("plan", "pattern"),
    "--stepover": Target("plan", "stepover_m", MM),
    "--lead-in": Target("plan", "lead_in"),
    "--lead-angle": Target("plan", "lead_angle_rad", DEG),
    "--tilt-angle": Target("plan", "tilt_angle_rad", DEG),
    "--controller": Target("controller", "name"),
    "--contact-force": Target("process", "contact_force_n", 1.0),
    "--feed": Target("process", "feed_m_s", MM),
    "--pad-diameter": Target("pad", "radius_m", 0.5 * MM),
    "--spindle-rpm": Target("spindle", "speed_rpm", 1.0),
}


def build_scenario(base: Scenario, given: Mapping[str, Any], config: Path | None, assignments: list[str]) -> Scenario:
    """Put a scenario together: defaults, then the config file, then the options, then --set.

    Args:
        base: The experiment's defaults.
        given: Options by name as in ``OPTIONS`` plus ``--part-pose``, ``--log-rate`` and ``--seed``; None = not given.
        config: A TOML file.
        assignments: ``KEY=VALUE`` strings of --set.

    Returns:
        The scenario.

    Raises:
        ConfigError: If a key or value is wrong; the message names the file, option or key.
        InputError: If an option cannot be understood.
    """
    scenario = base if config is None else load_scenario(config, base)
    if scenario.experiment != base.experiment:
        raise ConfigError(f"'{config}' is for the experiment '{scenario.experiment}', not '{base.experiment}'.")
    for option, value in given.items():
        if value is not None:
            scenario = _apply(scenario, option, value)
    return _placed(override(scenario, assignments))


def _placed(scenario: Scenario) -> Scenario:
    """Name a part's file from the root, so that the written config runs from any folder."""
    file = Path(scenario.part.file)
    return merge(scenario, {"part": {"file": str(file.resolve())}}, "") if file.is_file() else scenario


def parse_pose(text: str) -> list[float]:
    """Read X,Y,Z,RX,RY,RZ in mm and deg (rotation vector, as the robot shows it) into [m, rad]."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 6 or not all(math.isfinite(number) for number in numbers):
        raise InputError(
            f"--part-pose '{text}' is not X,Y,Z,RX,RY,RZ: six numbers in mm and deg, e.g. -100,-500,50,0,0,90."
        )
    return [number * MM for number in numbers[:3]] + [math.radians(number) for number in numbers[3:]]


def parse_log_rate(text: str) -> float:
    """Read rows per second, or `full` (every step, written as 0 in the scenario) [Hz]."""
    if text == "full":
        return 0.0
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not rate > 0.0:
        raise InputError(f"--log-rate '{text}' is neither a rate above 0 in Hz nor 'full'.")
    return rate


def _apply(scenario: Scenario, option: str, value: Any) -> Scenario:
    try:
        return merge(scenario, _table(option, value), "")
    except ConfigError as error:
        raise ConfigError(f"{option} {value}: {error}") from error


def _table(option: str, value: Any) -> dict[str, Any]:
    if option == "--seed":
        return {"seed": value}
    if option == "--part-pose":
        return {"part": {"pose": parse_pose(value)}}
    if option == "--log-rate":
        return {"simulation": {"log_rate_hz": parse_log_rate(value)}}
    section, name, unit = OPTIONS[option]
    return {section: {name: value if unit is None else value * unit}}
