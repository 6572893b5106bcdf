"""From the command line's units (mm, deg, N, mm/s) to a scenario in SI: the one place where the two meet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, NamedTuple

from polish_sim.config import Scenario
from polish_sim.errors import ConfigError, InputError
from polish_sim.scenario_file import load_scenario, merge, override


class Unit(NamedTuple):
    """A unit of the command line."""

    name: str
    si: float
    """What one of it is in SI, or in what the key counts."""


MM: Final = Unit("mm", 1e-3)
DEG: Final = Unit("deg", math.pi / 180.0)
MM_S: Final = Unit("mm/s", 1e-3)
DEG_S: Final = Unit("deg/s", math.pi / 180.0)
SECOND: Final = Unit("s", 1.0)
NEWTON: Final = Unit("N", 1.0)
PER_MINUTE: Final = Unit("1/min", 1.0)
DIAMETER: Final = Unit("mm", 0.5e-3)
"""A diameter in mm, where the key is a radius."""
DIRECTION: Final = Unit("", 1.0)


class Target(NamedTuple):
    """The key of the scenario an option sets, and the option's unit; None for a name."""

    section: str
    key: str
    unit: Unit | None = None


OPTIONS: Final[Mapping[str, Target]] = {
    "--part": Target("part", "file"),
    "--real-part": Target("part", "real_file"),
    "--units": Target("part", "unit"),
    "--up": Target("part", "up"),
    "--region": Target("plan", "region"),
    "--feature-angle": Target("plan", "feature_angle_rad", DEG),
    "--edge-margin": Target("plan", "edge_margin_m", MM),
    "--pattern": Target("plan", "pattern"),
    "--stepover": Target("plan", "stepover_m", MM),
    "--order": Target("plan", "order"),
    "--direction": Target("plan", "direction"),
    "--lead-in": Target("plan", "lead_in"),
    "--lead-angle": Target("plan", "lead_angle_rad", DEG),
    "--tilt-angle": Target("plan", "tilt_angle_rad", DEG),
    "--axis-smoothing": Target("plan", "axis_smoothing_m", MM),
    "--axis-deviation": Target("plan", "axis_deviation_rad", DEG),
    "--controller": Target("controller", "name"),
    "--contact-force": Target("process", "contact_force_n", NEWTON),
    "--feed": Target("process", "feed_m_s", MM_S),
    "--pad-diameter": Target("pad", "radius_m", DIAMETER),
    "--spindle-rpm": Target("spindle", "speed_rpm", PER_MINUTE),
    "--poses": Target("payload", "poses"),
    "--mode": Target("guide", "mode"),
    "--follow": Target("drag", "follow"),
    "--duration": Target("guide", "duration_s", SECOND),
    "--master-speed": Target("dual", "master_speed_m_s", MM_S),
    "--master-turn": Target("dual", "master_turn_rad_s", DEG_S),
    "--master-path": Target("dual", "master_path"),
    "--standoff": Target("dual", "standoff_m", MM),
    "--noise": Target("sensor", "force_noise_n", NEWTON),
}

CALIBRATIONS: Final[Mapping[str, tuple[str, str]]] = {
    "payload": ("payload", "file"),
    "base": ("dual", "bases_file"),
    "tcp": ("dual", "tool_file"),
    "arm": ("dual", "arms_file"),
}
"""Where the file of each kind of calibration goes in a run of two robots."""

TRIPLES: Final[Mapping[str, Target]] = {
    "--start": Target("plan", "start", MM),
    "--raster-direction": Target("plan", "raster_direction", DIRECTION),
}
"""Options of the form X,Y,Z."""

FILE_REGIONS: Final = ("polygon", "faces")
"""Regions that may be read from a file."""

OTHERS: Final = ("--calibration", "--overlap", "--part-pose", "--log-rate", "--seed", "--fault")
"""Options with a reading of their own."""


def given_options(*groups: object) -> dict[str, Any]:
    """Options by the names a user writes.

    Args:
        groups: Groups of options: dataclasses or mappings, by the names Python has for them, e.g. ``pad_diameter``;
            other options may be among them.

    Returns:
        Those that set something of the scenario, e.g. ``--pad-diameter``; None where not given.
    """
    given = {
        name: value
        for group in groups
        for name, value in (group if isinstance(group, Mapping) else vars(group)).items()
    }
    named = {"--" + name.replace("_", "-"): value for name, value in given.items()}
    return {option: named[option] for option in (*OPTIONS, *TRIPLES, *OTHERS) if option in named}


def build_scenario(base: Scenario, given: Mapping[str, Any], config: Path | None, assignments: list[str]) -> Scenario:
    """Put a scenario together: defaults, then the config file, then the options, then --set.

    Args:
        base: The experiment's defaults.
        given: Options by name, see `given_options`; None = not given.
        config: A TOML file.
        assignments: ``KEY=VALUE`` strings of --set.

    Returns:
        The scenario.

    Raises:
        ConfigError: If a key or value is wrong; the message names the file, option or key, in the option's unit.
        InputError: If an option cannot be understood.
    """
    scenario = base if config is None else load_scenario(config, base)
    if scenario.experiment != base.experiment:
        raise ConfigError(f"'{config}' is for the experiment '{scenario.experiment}', not '{base.experiment}'.")
    for option, value in given.items():
        if value is not None and option != "--overlap":
            word = str(value) if isinstance(value, Path) else value
            scenario = merge(scenario, _table(option, word, base.experiment), "")
    scenario = override(scenario, assignments)
    # The overlap is a share of the pad, whoever set that.
    if given.get("--overlap") is not None:
        scenario = _overlapping(scenario, given.get("--stepover"), given["--overlap"])
    return _placed(scenario)


def _overlapping(scenario: Scenario, stepover: float | None, overlap: float) -> Scenario:
    """Set the step-over that leaves neighbouring turns the overlap asked for."""
    if stepover is not None:
        raise InputError("--overlap and --stepover both set the distance between turns: give one of them.")
    if not 0.0 <= overlap < 100.0:
        raise InputError(f"--overlap {overlap:g} is not a percentage from 0 to below 100.")
    distance = 2.0 * scenario.pad.radius_m * (1.0 - 0.01 * overlap)
    least = _spec(OPTIONS["--stepover"])["low"]
    if distance < least:
        raise InputError(
            f"--overlap {overlap:g} of a pad of {scenario.pad.radius_m * 2e3:g} mm leaves a step-over of "
            f"{distance * 1e3:.3g} mm, less than the smallest possible, {least * 1e3:g} mm. Give a smaller overlap."
        )
    return merge(scenario, {"plan": {"stepover_m": distance}}, "")


def _placed(scenario: Scenario) -> Scenario:
    """Name every file a scenario names from the root, so that the written config runs from any folder."""
    others = (("part", "file"), ("part", "real_file"), ("dual", "master_path"), ("drag", "follow"))
    files = (*others, *CALIBRATIONS.values())
    for section, key in files:
        file = Path(getattr(getattr(scenario, section), key))
        if file.is_file():
            scenario = merge(scenario, {section: {key: str(file.resolve())}}, "")
    choice, _, words = scenario.plan.region.partition(":")
    if choice in FILE_REGIONS and Path(words).is_file():
        scenario = merge(scenario, {"plan": {"region": f"{choice}:{Path(words).resolve()}"}}, "")
    file_name, _, class_name = scenario.controller.name.rpartition(":")
    if Path(file_name).is_file():
        scenario = merge(scenario, {"controller": {"name": f"{Path(file_name).resolve()}:{class_name}"}}, "")
    return scenario


def parse_pose(text: str) -> list[float]:
    """Read X,Y,Z,RX,RY,RZ in mm and deg (rotation vector, as the robot shows it) into [m, rad]."""
    numbers = _numbers(text, 6)
    if not numbers:
        raise InputError(
            f"--part-pose '{text}' is not X,Y,Z,RX,RY,RZ: six numbers in mm and deg, e.g. -100,-500,50,0,0,90."
        )
    return [number * MM.si for number in numbers[:3]] + [math.radians(number) for number in numbers[3:]]


def parse_triple(option: str, text: str) -> list[float]:
    """Read X,Y,Z of an option in its unit into SI.

    Raises:
        InputError: It is not three numbers, or a direction without length.
    """
    unit = TRIPLES[option].unit or DIRECTION
    numbers = _numbers(text, 3)
    if not numbers or (unit is DIRECTION and not any(numbers)):
        said = f"three numbers in {unit.name}" if unit.name else "a direction, not all zero, e.g. 1,0,0"
        raise InputError(f"{option} '{text}' is not X,Y,Z: {said}.")
    return [number * unit.si for number in numbers]


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


def _numbers(text: str, count: int) -> list[float]:
    """So many finite numbers between commas; empty if it is anything else."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        return []
    return numbers if len(numbers) == count and all(math.isfinite(number) for number in numbers) else []


def _table(option: str, value: Any, experiment: str) -> dict[str, Any]:
    if option == "--calibration":
        return _calibrations(value, experiment)
    if option == "--direction" and experiment == "teach":
        return {"guide": {"direction": value}}
    if option == "--seed":
        return {"seed": value}
    if option == "--fault":
        return {"faults": {"events": ", ".join(value)}}
    if option == "--part-pose":
        return {"part": {"pose": parse_pose(value)}}
    if option == "--log-rate":
        return {"simulation": {"log_rate_hz": parse_log_rate(value)}}
    if option in TRIPLES:
        return {TRIPLES[option].section: {TRIPLES[option].key: parse_triple(option, value)}}
    target = OPTIONS[option]
    return {target.section: {target.key: value if target.unit is None else _in_si(option, value)}}


def _calibrations(files: Sequence[Path], experiment: str) -> dict[str, Any]:
    """Each file where its kind of calibration goes.

    Raises:
        InputError: Two of one kind, or not a calibration.
    """
    if experiment != "dual":
        if len(files) > 1:
            raise InputError("--calibration is given more than once: a run of one robot takes one, of 'payload'.")
        section, key = CALIBRATIONS["payload"]
        return {section: {key: str(files[0])}}
    # Lazy: only a run of two robots reads a calibration to see what it is of.
    from polish_sim.calibration import calibration_kind

    taken: dict[str, Path] = {}
    for file in files:
        kind = calibration_kind(file, tuple(CALIBRATIONS))
        if kind in taken:
            raise InputError(
                f"'{taken[kind]}' and '{file}' are both calibrations of the kind '{kind}': give one of each."
            )
        taken[kind] = file
    table: dict[str, Any] = {}
    for kind, file in taken.items():
        section, key = CALIBRATIONS[kind]
        table.setdefault(section, {})[key] = str(file)
    return table


def _in_si(option: str, value: float) -> float:
    """The value in SI, within the key's range; the message keeps to the unit the user wrote.

    Raises:
        ConfigError: It is not a number or out of range.
    """
    target = OPTIONS[option]
    unit, spec = target.unit or DIRECTION, _spec(target)
    number = value * unit.si
    if not spec["low"] <= number <= spec["high"]:
        meaning = str(spec["text"]).rpartition(" [")[0]
        meaning = meaning.replace("radius", "diameter") if unit is DIAMETER else meaning
        low, high = spec["low"] / unit.si, spec["high"] / unit.si
        raise ConfigError(f"{option} {value:g} is outside {low:.4g} to {high:.4g} {unit.name}: {meaning}.")
    return number


def _spec(target: Target) -> Mapping[str, Any]:
    """Meaning and range of a key."""
    section = getattr(Scenario(), target.section)
    return next(field.metadata for field in fields(section) if field.name == target.key)
