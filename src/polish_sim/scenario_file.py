"""Scenario dataclasses to TOML and back, strict on unknown keys, types and ranges."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import Field, fields, is_dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

from polish_sim.config import Scenario
from polish_sim.errors import ConfigError, check_name, named_place, nearest, number_text
from polish_sim.toml_text import read_toml, toml_text

T = TypeVar("T")
N = TypeVar("N", int, float)
PRESETS = ("sensor.model", "robot.arm")  #: Keys whose words stand for values of others; they are set first
PAD_CHOICE = "pad.choice"  #: Set last: a pad or a step-over that is set by name changes it
#: Stands for a list of numbers that is chosen where it is not given; older files have an empty list
AUTO = "auto"
FILE_KEYS = (
    "part.file", "part.real_file", "part.fixture_file", "payload.file", "drag.follow",
    "smoothing.limits_file", "dual.bases_file", "dual.tool_file", "dual.arms_file", "dual.master_path",
    "guide.model_file", "plan.removal", "process.learn", "robot.compensation",
)  # fmt: skip
"""The keys that name a file; ``plan.file`` may be a folder, a controller's name and a
region may hold one."""
COUNTS = {2: "two", 3: "three", 6: "six"}
KINDS = {str: "text", bool: "true or false", int: "a whole number", float: "a number"}
"""Types of values and what messages call them; every switch is a whole number too."""
_ROBOT_BEFORE_ARMS = {
    "command_latency_s", "linear_acceleration_m_s2", "angular_acceleration_rad_s2", "command_timeout_s",
    "joint_speed_limit_rad_s", "payload_error",
}  # fmt: skip
"""All keys of [robot] in a run's config.toml of the time before robot.arm: its arm was the ideal one."""
_RETIRED = (
    ("adaptive", "force_rate_n_s"), ("baselines", "mass_kg"), ("baselines", "damping_n_s_m"),
    ("baselines", "stiffness_n_m"),
)  # fmt: skip
"""Keys of [controller] that every config.toml of older runs has and no law reads any more: they are passed
over."""
_AS_POSES = "It is gone: give arcs and other axes as poses over time, in the file of dual.master_path."
_SAID_NOTHING: tuple[Any, ...] = (0.0, [], AUTO)
_GONE: dict[str, tuple[tuple[Any, ...], str]] = {
    "dual.master_arc_radius_m": (_SAID_NOTHING, _AS_POSES),
    "dual.master_axis": (_SAID_NOTHING, _AS_POSES),
    "dual.master_center": (_SAID_NOTHING, _AS_POSES),
    "drag.tolerance_m": (
        (3e-4,),
        "It is gone: a path was simplified to lines within it. A spline is fitted now, of the rms distance "
        "drag.fit_rms_m.",
    ),
}
"""Keys that are gone: values of older configs that are passed over, and what stands for the others."""


def load_scenario(path: Path, base: Scenario) -> Scenario:
    """Read a TOML file on top of a base scenario.

    Raises ConfigError if the file cannot be read, or names an unknown key or a value of the wrong type or out
    of range.
    """
    table = read_toml(path, "config file", ConfigError)
    robot = table.get("robot")
    if isinstance(robot, dict) and robot.keys() == _ROBOT_BEFORE_ARMS:
        robot["arm"] = "ideal"
    controller = table.get("controller")
    if isinstance(controller, dict):
        for name, key in _RETIRED:
            if isinstance(section := controller.get(name), dict):
                section.pop(key, None)
    for where, (passed_over, _) in _GONE.items():
        place, _, key = where.partition(".")
        if isinstance(section := table.get(place), dict) and section.get(key) in passed_over:
            del section[key]
    with named_place(f"'{path}'"):
        return merge(base, table, "")


def override(base: Scenario, assignments: Sequence[str]) -> Scenario:
    """Apply ``KEY=VALUE`` strings such as ``sensor.force_noise_n=0.2``; a bare word is taken as a string."""
    scenario = base
    for assignment in sorted(assignments, key=_rank):
        dotted, separator, text = assignment.partition("=")
        if not separator or not dotted.strip():
            raise ConfigError(f"'--set {assignment}' is not KEY=VALUE, e.g. --set sensor.force_noise_n=0.2.")
        scenario = merge(scenario, nested(dotted.strip(), parse_value(text.strip())), "")
    if scenario.experiment != base.experiment:
        raise ConfigError(
            f"the experiment is '{base.experiment}': leave the setting experiment={scenario.experiment} out."
        )
    return scenario


def nested(key: str, value: Any) -> Any:
    """A dotted key and its value as a nested table."""
    for name in reversed(key.split(".")):
        value = {name: value}
    return value


def counted_seeds(first: int | None, count: int) -> range:
    """Seeds counted up from a first one, 0 if none is given; ConfigError if the last one is too large."""
    seeds = range(first or 0, (first or 0) + count)
    merge(Scenario(), {"seed": seeds[-1]}, "")
    return seeds


def with_files(scenario: Scenario, folder: Path) -> Scenario:
    """Give the whole path of every file a scenario names from a folder."""
    for key in FILE_KEYS:
        word = attrgetter(key)(scenario)
        file = folder / word
        if word and file.exists():
            scenario = merge(scenario, nested(key, str(file.resolve())), "")
    scenario = merge(scenario, {"plan": {"region": region_with_file(scenario.plan.region, folder)}}, "")
    file_name, _, class_name = scenario.controller.name.rpartition(":")
    if (file := folder / file_name).is_file():
        scenario = merge(scenario, {"controller": {"name": f"{file.resolve()}:{class_name}"}}, "")
    return scenario


def region_with_file(region: str, folder: Path) -> str:
    """The same of a region."""
    choice, _, words = region.partition(":")
    named, colon, share = words.rpartition(":") if choice == "under" else (words, "", "")
    file = folder / named
    return f"{choice}:{file.resolve()}{colon}{share}" if file.is_file() else region


def _rank(assignment: str) -> int:
    """Order of setting: presets first, `PAD_CHOICE` last."""
    name = assignment.partition("=")[0].strip()
    return (name == PAD_CHOICE) - (name in PRESETS)


def presets_in(assignments: Sequence[str]) -> list[str]:
    """Those of ``KEY=VALUE`` that choose a preset: set before all others, they leave what is set by name."""
    return [assignment for assignment in assignments if _rank(assignment) < 0]


def merge(base: T, table: dict[str, Any], place: str) -> T:
    """Return ``base`` with the values of a (nested) table, each checked against its field."""
    if isinstance(base, Scenario):
        table = _with_pad_choice(base.pad.choice, table)
    known: dict[str, Field[Any]] = {f.name: f for f in fields(base)}  # type: ignore[arg-type]
    base = _with_presets(base, table, place, known)
    changes: dict[str, Any] = {}
    for name, value in table.items():
        where = f"{place}{name}"
        if where in _GONE:
            raise ConfigError(f"unknown key '{where}'. {_GONE[where][1]}")
        if name not in known:
            raise ConfigError(
                f"unknown key '{where}'.{_nearest_key(name, place, known, isinstance(value, dict))} "
                f"Known here: {', '.join(sorted(known))}."
            )
        current = getattr(base, name)
        if is_dataclass(current):
            if not isinstance(value, dict):
                raise ConfigError(f"'{where}' is a section: write [{where}] and its keys below.")
            changes[name] = merge(current, value, f"{where}.")
        elif isinstance(current, Mapping):
            changes[name] = {**current, **_plain_values(where, value)}
        else:
            changes[name] = checked_value(where, value, current, known[name])
    return replace(base, **changes)  # type: ignore[type-var]


def _with_pad_choice(choice: str, table: dict[str, Any]) -> dict[str, Any]:
    """``table`` with a ``pad.choice`` that keeps the pad or the step-over it names, also where that is the
    default."""
    pad, plan = table.get("pad", {}), table.get("plan", {})
    if not isinstance(pad, dict) or not isinstance(plan, dict):
        return table
    if "radius_m" in pad:
        choice = "given"
    elif "stepover_m" in plan and choice == "auto":
        choice = "stepover"
    else:
        return table
    return {**table, "pad": {"choice": choice, **pad}}


def _plain_values(where: str, table: Any) -> dict[str, Any]:
    """A section of free keys, with numbers, words and switches alone."""
    if not isinstance(table, dict):
        raise ConfigError(
            f"'{where}' is a section: write [{where}] and its keys below, or --set {where}.KEY=VALUE."
        )
    for name, value in table.items():
        if not (isinstance(value, (bool, str)) or is_number(value)):
            raise ConfigError(f"'{where}.{name}' must be a number, text, true or false, got {_shown(value)}.")
    return table


def _with_presets(base: T, table: dict[str, Any], place: str, known: dict[str, Field[Any]]) -> T:
    """``base`` with the values that words of ``table`` stand for; what differs from the word before was set
    by name."""
    for name, spec in known.items():
        presets, word = spec.metadata.get("presets"), table.get(name)
        if not presets or not isinstance(word, str):
            continue
        check_name(f"{place}{name}", word, presets)
        base = _turned(base, presets.values(), presets.get(getattr(base, name), {}), presets[word])
    return base


def _turned(
    base: T, every: Iterable[Mapping[str, Any]], before: Mapping[str, Any], after: Mapping[str, Any]
) -> T:
    """``base`` with what one preset stands for instead of another; in sections of it key by key."""
    changes: dict[str, Any] = {}
    for key in {key for values in every for key in values}:
        current = getattr(base, key)
        if is_dataclass(current):
            inner = [values.get(key, {}) for values in every]
            changes[key] = _turned(current, inner, before.get(key, {}), after.get(key, {}))
        else:
            usual = next(f.default for f in fields(base) if f.name == key)  # type: ignore[arg-type]
            if current == before.get(key, usual):
                changes[key] = after.get(key, usual)
    return replace(base, **changes)  # type: ignore[type-var]


def _nearest_key(name: str, place: str, known: Iterable[str], section: bool) -> str:
    """Ask whether the nearest name of the same section was meant, or any key where no section is named."""
    here = nearest(name, known) or next((key for key in known if name in key), "")
    if here:
        return f" Did you mean '{place}{here}'?"
    everywhere = {} if place or section else {name.rpartition(".")[2]: name for name, _ in leaves(Scenario())}
    near = nearest(name, everywhere)
    return f" Did you mean '{everywhere[near]}'?" if near else ""


def leaves(table: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Every key of a section, or of a nested table, by its dotted name, with its value."""
    known = table if isinstance(table, Mapping) else {f.name: getattr(table, f.name) for f in fields(table)}
    for name, value in known.items():
        if is_dataclass(value) or isinstance(value, Mapping):
            yield from leaves(value, f"{place}{name}.")
        else:
            yield f"{place}{name}", value


def section_keys(section: Any, place: str = "") -> Iterator[tuple[str, Field[Any], Any]]:
    """Every key of a section by its dotted name, with its field and value; free keys in one."""
    for f in fields(section):
        name, value = f"{place}{f.name}", getattr(section, f.name)
        if is_dataclass(value):
            yield from section_keys(value, f"{name}.")
        else:
            yield name, f, value


def check_words(section: Any, place: str = "") -> None:
    """Refuse words that keys of a section do not take (InputError)."""
    for name, f, value in section_keys(section, place):
        if known := f.metadata.get("presets"):
            check_name(name, value, known)


def to_toml(scenario: Scenario) -> str:
    """Write the whole scenario as TOML, each key with its meaning and unit as a comment."""
    comments: dict[str, str] = {}
    return toml_text(_table_of(scenario, "", comments), comments)


def _table_of(section: Any, place: str, comments: dict[str, str]) -> dict[str, Any]:
    """A section as a nested table; the meaning of each key goes into ``comments``."""
    table: dict[str, Any] = {}
    for f in fields(section):
        value = getattr(section, f.name)
        name = f"{place}{f.name}"
        if is_dataclass(value):
            comments[name] = (type(value).__doc__ or "").strip().splitlines()[0]
            table[f.name] = _table_of(value, f"{name}.", comments)
        else:
            comments[name] = f.metadata["text"]
            if isinstance(value, Mapping):
                table[f.name] = dict(value)
                continue
            table[f.name] = AUTO if value == f.default == () else value
    return table


def parse_value(text: str) -> Any:
    """A value as ``--set`` takes it: TOML, else the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # no TOML, thousands of digits or of brackets
        return text


def numbers_of(text: str, count: int) -> list[float]:
    """Finite numbers separated by commas, ``count`` of them; an empty list if the text is not that."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        return []
    return numbers if len(numbers) == count and all(map(math.isfinite, numbers)) else []


def checked_value(where: str, value: Any, current: Any, spec: Field[Any]) -> Any:
    """A value of the type of the ``current`` one and within its field's range."""
    if isinstance(current, tuple):
        length = spec.metadata["length"]
        lengths, or_auto = ((0, length), f" (or {AUTO})") if spec.default == () else ((length,), "")
        value = () if value == AUTO and spec.default == () else value
        listed = isinstance(value, (list, tuple)) and len(value) in lengths
        if not listed or not all(is_number(v) for v in value):
            raise ConfigError(
                f"'{where}' must be a list of {COUNTS[length]} numbers{or_auto}, got {_shown(value)}."
            )
        return tuple(float(_within(where, v, spec)) for v in value)
    kind = next(kind for kind in KINDS if isinstance(current, kind))
    fits = is_number(value) if kind is float else type(value) is kind
    if not fits or (kind is str and "\0" in value):
        raise ConfigError(f"'{where}' must be {KINDS[kind]}, got {_shown(value)}.")
    return value if kind in (str, bool) else kind(_within(where, value, spec))


def _within(where: str, number: N, spec: Field[Any]) -> N:
    low, high = spec.metadata["low"], spec.metadata["high"]
    if not low <= number <= high:
        raise ConfigError(
            f"'{where}' = {_shown(number)} is outside {number_text(low)} to {number_text(high)}: "
            f"{spec.metadata['text']}."
        )
    return number


def _shown(value: Any) -> str:
    """A value as a message gives it: one of very many digits is cut."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:12]}... ({len(text)} characters)"


def is_number(value: Any) -> bool:
    """Whether a value is a finite number, no switch."""
    return not isinstance(value, bool) and (
        isinstance(value, int) or (isinstance(value, float) and math.isfinite(value))
    )
