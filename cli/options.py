"""The options of the commands: those of the config's keys, generated, and those without a key.

A user writes mm, deg, N and mm/s; what a command is given is in SI. Each option is declared once: in the
config, where it sets a key, else here or beside its command.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial, wraps
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperOption

from polish_sim.config import PadConfig, PlanConfig, Scenario
from polish_sim.config.key import CONFIG, DIAMETER, OUTPUT, PAIR, PANELS, PATH, POSE, RUN, TOOL, Option, Unit
from polish_sim.errors import ConfigError, InputError, number_text, refuse_idle
from polish_sim.scenario_file import (
    AUTO,
    COUNTS,
    load_scenario,
    merge,
    nested,
    numbers_of,
    override,
    presets_in,
    section_keys,
    with_files,
)
from polish_sim.workers import engine

Given = Mapping[str, Any]  #: Options by name, e.g. ``--feed``, in SI; None where not given.

PURE = Unit("", 1.0)
_IN_RUNS = {
    "payload": "payload.file",
    "base": "dual.bases_file",
    "tcp": "dual.tool_file",
    "arm": "dual.arms_file",
}
"""The key of each kind of calibration file."""


class Own(NamedTuple):
    """An option of a command."""

    name: str
    panel: str
    metavar: str  #: What stands for its value; empty for a switch
    text: str
    kind: type = str  #: Of its value: str, int, float, Path, or list for one that may be repeated
    low: float = -math.inf  #: Least value [SI]
    high: float = math.inf  #: Largest value [SI]
    unit: Unit = PURE
    parser: Callable[[str], Any] | None = None  #: Of its value, where the above does not say all
    key: str = ""  #: Of the config, dotted, which it sets; empty if it sets none
    meaning: str = ""  #: Of that key, without a unit

    def read(self, text: str) -> Any:
        """Read its value, a number into SI.

        Raises:
            InputError: It is not a number; says its unit.
            ConfigError: It is out of range; in the unit.
        """
        if self.parser:
            return self.parser(text)
        if self.kind not in (int, float):
            return Path(text) if self.kind is Path else text
        unit, word = self.unit, text.strip()
        if word in unit.words:
            return unit.words[word]
        try:
            number = self.kind(word)
        except ValueError:
            wanted = f" ({' or '.join([unit.name, *unit.words])})" if unit.name else ""
            said = re.fullmatch(rf"([-+.\de]+) *{unit.name}", word)
            write = f" Write {said[1]}." if said and unit.name else ""
            whole = "whole " if self.kind is int else ""
            raise InputError(f"{self.name} '{text[:40]}' is not a {whole}number{wanted}.{write}") from None
        value = number * unit.si if self.kind is float else number
        if not self.low <= value <= self.high:
            low, high = (number_text(self.kind(end / unit.si), 4) for end in (self.low, self.high))
            bounds = f"{low} to {high} {unit.name}".rstrip()
            meaning = f": {self.meaning}" if self.meaning else ""
            message = f"{self.name} {number_text(number)} is outside {bounds}{meaning}."
            if unit.name.startswith("mm") and self.low <= number <= self.high:
                metres = unit.name.replace("mm", "m", 1)
                message += f" For {number_text(number)} {metres} write {number_text(1e3 * number)}."
            raise ConfigError(message)
        return value

    def given(self, words: Any) -> Any:
        """What was given, read; None where nothing was: neither is a switch that is off."""
        if isinstance(words, str):
            return self.read(words)
        return list(map(self.read, words)) if isinstance(words, list) else words or None


OWN = {
    own.name: own
    for own in (
        Own(
            "--overlap",
            PATH,
            "PERCENT",
            "Set the step-over by the overlap of neighbouring turns, in percent of the pad's diameter.",
            float,
            0.0,
            100.0,
        ),
        Own(
            "--even-removal",
            PATH,
            "",
            "Feed and force such that as much comes off everywhere: --removal even.",
        ),
        Own(
            "--calibration",
            RUN,
            "FILE",
            "calibration.toml of 'calibrate payload': the tool whose weight is compensated; in dual also of "
            "'calibrate arm', 'base' and 'tcp', one of each; default: calibrated before the run.",
            list,
        ),
        Own(
            "--tool",
            TOOL,
            "NAME",
            "Of the tool library, see 'polish-sim list tools'; FILE.toml:NAME for one of your own.",
        ),
        Own(
            "--seeds",
            RUN,
            "N",
            "Run this many seeds, counting up from --seed; --out of some begun continues them.",
            int,
            low=1,
            high=1e6,
        ),
        Own("--workers", RUN, "N", "Processes to share the runs out to; default: all.", int, 1, 1e4),
        Own(
            "--on",
            RUN,
            "ENGINE",
            "Where: local (default), dask (a cluster on this machine, with a dashboard), "
            "tcp://HOST:PORT or tls://HOST:PORT (a Dask scheduler).",
            parser=engine,
        ),
        Own("--dry-run", RUN, "", "Plan and check the reach, do not simulate."),
        Own(
            "--allow-contact",
            RUN,
            "",
            "Run a path on which the tool runs into the part; default: it is refused.",
        ),
        Own("--check", RUN, "", "Exit with 1 when a figure falls short of what is asked of it."),
        Own("--view", RUN, "", "Watch the run in the MuJoCo viewer."),
        Own(
            "--live",
            RUN,
            "",
            "Watch it in a browser and change it there (needs viser).",
        ),
        Own(
            "--live-port",
            RUN,
            "N",
            "Port of the page; default: the first free one from 8080 on.",
            int,
            low=1,
            high=65535,
        ),
        Own(
            "--live-host",
            RUN,
            "ADDRESS",
            "Serve the page at this address of the computer; default: 127.0.0.1, for "
            "nobody else. It has no password: whoever reaches the address can watch and change the run.",
        ),
        Own("--reach-map", OUTPUT, "", "Draw where the part may stand for the arm to do the path."),
        Own(
            "--dual",
            PAIR,
            "",
            "For two robots: once around the rim; reach, limits and collisions of both arms are checked.",
        ),
        Own("--config", CONFIG, "FILE.toml", "TOML file; see 'polish-sim config'.", Path),
        Own("--set", CONFIG, "KEY=VALUE", "KEY=VALUE of the config; may be repeated.", list),
        Own("--video", OUTPUT, "", "Write a film of the run, cell, pad and force (video.mp4)."),
        Own(
            "--export",
            OUTPUT,
            "NAME",
            "Also write the plan as apt, urscript, ros, ply, glb, html, or all of them; may be repeated.",
            list,
        ),
        Own(
            "--out",
            OUTPUT,
            "DIR",
            "Output folder; default results/<command>[-<experiment>]/<date-time>.",
            Path,
        ),
        Own("--overwrite", OUTPUT, "", "Replace files in an existing output folder."),
    )
}
CONFIG_OPTIONS = ("--config", "--set")
OUTPUT_OPTIONS = ("--out", "--overwrite")


def config_keys(defaults: Scenario) -> dict[str, Own]:
    """The options of the config's keys by their names; ``teach`` has a ``--direction`` of its own."""
    found: dict[str, Own] = {}
    for key, field, value in section_keys(defaults):
        option = field.metadata.get("option")
        if option and (option.name not in found or defaults.experiment == "teach"):
            found[option.name] = _own_of(key, option, value, field.metadata)
    return found


def _own_of(key: str, option: Option, default: Any, spec: Mapping[str, Any]) -> Own:
    """The option of a key with its meaning and range."""
    meaning = option.help or re.sub(r" \[[^]]*\]", "", spec["text"])
    if option.unit is DIAMETER:
        meaning = meaning.replace("radius", "diameter")
    own = Own(
        option.name, option.panel, option.metavar, _help(meaning, option, default), str, spec["low"],
        spec["high"], key=key, meaning=meaning,
    )  # fmt: skip
    if option.repeat:
        return own._replace(kind=list)
    if isinstance(default, tuple):
        return own._replace(parser=partial(_read_list, option, spec["length"], default))
    if isinstance(option.unit, Unit):
        return own._replace(kind=float, unit=option.unit)
    return own._replace(kind=int) if isinstance(default, int) else own


def takes(
    *options: str | Own, defaults: Scenario = Scenario()
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Let a command take options: its argument ``given`` becomes one parameter an option, as Typer reads
    them.

    They are named as in the config or ``OWN``, or the command's own; the help names the values of
    ``defaults``.
    """
    known = config_keys(defaults) | OWN
    chosen = [option if isinstance(option, Own) else known[option] for option in options]
    chosen.sort(key=lambda option: PANELS.index(option.panel) if option.panel in PANELS else -1)
    named = {f"option_{number}": option for number, option in enumerate(chosen)}

    def decorated(command: Callable[..., Any]) -> Callable[..., Any]:
        own = inspect.signature(command, eval_str=True).parameters.values()
        flat = [p for p in own if p.name != "given"] + list(map(_declared, named, chosen))

        @wraps(command)
        def flattened(**values: Any) -> Any:
            given = {option.name: option.given(values.pop(word)) for word, option in named.items()}
            return command(given=given, **values)

        signature = inspect.Signature([p.replace(kind=p.KEYWORD_ONLY) for p in flat])
        flattened.__signature__ = signature  # type: ignore[attr-defined]
        flattened.__annotations__ = {p.name: p.annotation for p in flat}
        return flattened

    return decorated


def _declared(parameter: str, option: Own) -> inspect.Parameter:
    """An option as a parameter Typer understands."""
    switch = not option.metavar
    kind: Any = bool if switch else list[str] | None if option.kind is list else str | None
    declared = typer.Option(
        option.name,
        metavar=option.metavar,
        help=option.text,
        rich_help_panel=option.panel,
        show_default=False,
    )
    return inspect.Parameter(
        parameter,
        inspect.Parameter.KEYWORD_ONLY,
        default=False if switch else None,
        annotation=Annotated[kind, declared],
    )


# An option's words as they are, `takes` reads them: Typer imports pydantic for it, 0.1 s of a start.
TyperOption.process_value = lambda option, context, words: (  # type: ignore[assignment, method-assign]
    option.callback(context, option, words) if option.callback else words
)


def argument(name: str, text: str) -> Any:
    """An argument of a command, for its annotation."""
    return typer.Argument(metavar=name, help=text, show_default=False)


def _help(meaning: str, option: Option, default: Any) -> str:
    """Meaning, unit and default of an option."""
    unit = option.unit
    word = "empty" if default == "" else AUTO
    text, _, empty = meaning.partition(f"; {word} = ")
    if isinstance(unit, Unit):
        text += f" ({unit.name})" if unit.name and f"({unit.name})" not in text else ""
        text += "".join(f"; {name} = {number_text(value / unit.si)}" for name, value in unit.words.items())
    if option.repeat:
        text += "; may be repeated"
    if empty and default in ("", ()):
        text += f"; default: {empty}" if word == "empty" else f", or auto: {empty}; default auto"
    elif default not in ("", ()) and default == default:  # not a number: found by the command
        shown = str(default)
        if isinstance(unit, Unit) and isinstance(default, float):
            shown = number_text(default / unit.si, 4)
        text += f"; default {shown}"
    listed = text.partition(" ")[0][-1:] in ",:"
    return (text if listed else text[:1].upper() + text[1:]) + "."


def _read_list(option: Option, count: int, default: tuple[float, ...], text: str) -> list[float]:
    """Read X,Y,Z or X,Y,Z,RX,RY,RZ (rotation vector, as the robot shows it) into SI."""
    if text.strip() == AUTO and default == ():
        return []
    unit = option.unit
    units: Any = POSE if unit == POSE else (unit,) * count
    numbers = numbers_of(text, count)
    direction = not units[0].name
    if not numbers or (direction and not any(numbers)):
        if direction:
            said = "a direction, not all zero, e.g. 1,0,0"
        elif unit == POSE:
            said = "six numbers in mm and deg, e.g. -100,-500,50,0,0,90"
        else:
            said = f"{COUNTS[count]} numbers in {units[0].name}"
        raise InputError(f"{option.name} '{text}' is not {option.metavar}: {said}.")
    return [number * unit.si for number, unit in zip(numbers, units, strict=True)]


def build_scenario(base: Scenario, given: Given) -> Scenario:
    """Put a scenario together: defaults, then the config file, then the options by name, then --set;
    presets before all that is set by name.

    Raises:
        ConfigError: If a key or value is wrong; the message names the file, option or key.
        InputError: If an option cannot be understood.
    """
    config = given.get("--config")
    presets = presets_in(given.get("--set") or [])
    scenario = override(base, presets)
    if config:
        scenario = override(load_scenario(config, scenario), presets)
    if scenario.experiment != base.experiment:
        raise ConfigError(
            f"'{config}' is for the experiment '{scenario.experiment}', not '{base.experiment}'."
        )
    return with_options(scenario, given)


#: Settings that are an option of their own
SWITCHES = {"--allow-contact": "safety.tool_in_part=allow", "--even-removal": "plan.removal=even"}


def with_options(scenario: Scenario, given: Given) -> Scenario:
    """A scenario with a tool, then the options, then --set on top of it. Raises as `build_scenario`."""
    tool = None
    if given.get("--tool"):
        from polish_sim.job.tools import choose_tool  # only this option reads the library

        tool = choose_tool(given["--tool"])
        scenario = merge(scenario, tool.settings(), "tool.")
    keys = config_keys(Scenario(experiment=scenario.experiment))
    settings = {
        keys[option].key: ", ".join(value) if keys[option].kind is list else value
        for option, value in given.items()
        if value is not None and option in keys
    }
    if files := given.get("--calibration"):
        settings |= _calibrations(files, scenario.experiment)
    for key, value in settings.items():
        scenario = merge(scenario, nested(key, value), "")
    if given.get("--even-removal") and given.get("--removal") is not None:
        raise InputError("--even-removal is --removal even: give one of them.")
    switched = [word for option, word in SWITCHES.items() if given.get(option)]
    scenario = override(scenario, [*switched, *(given.get("--set") or ())])
    # The overlap is a share of the pad, whoever set that.
    if given.get("--overlap") is not None:
        scenario = merge(scenario, _overlapping(scenario.pad, given, keys["--stepover"].low), "")
    if tool:
        tool.check_force(given["--tool"], scenario.process.contact_force_n)
    return with_files(scenario, Path())


def _overlapping(pad: PadConfig, given: Given, least: float) -> dict[str, Any]:
    """Settings with the step-over that leaves neighbouring turns the overlap asked for."""
    overlap = given["--overlap"]
    if given.get("--stepover") is not None:
        raise InputError("--overlap and --stepover both set the distance between turns: give one of them.")
    distance = 2.0 * pad.radius_m * (1.0 - 0.01 * overlap)
    if distance < least:
        raise InputError(
            f"--overlap {number_text(overlap)} of a pad of {number_text(pad.radius_m * 2e3)} mm "
            f"leaves a step-over of {number_text(distance * 1e3, 3)} mm, less than the smallest possible, "
            f"{number_text(least * 1e3)} mm. Give a smaller overlap."
        )
    return {"plan": {"stepover_m": distance}, "pad": {"choice": pad.choice}}


def _calibrations(files: Sequence[str], experiment: str) -> dict[str, str]:
    """Each file by the key of its kind of calibration; InputError: two of one kind, or none a run takes."""
    from polish_sim.calibration import read_table  # the numerical libraries are slow to import

    known = tuple(_IN_RUNS) if experiment == "dual" else ("payload",)
    taken: dict[str, str] = {}
    for file in files:
        kind = read_table(Path(file), *known).values["kind"]
        key = _IN_RUNS[kind]
        if key in taken:
            raise InputError(
                f"'{taken[key]}' and '{file}' are both calibrations of the kind '{kind}': give one of each."
            )
        taken[key] = file
    return taken


def chosen(given: Given, *names: str) -> dict[str, Any]:
    """Options that were given, by the names of a trial's fields."""
    return {name: given[f"--{name}"] for name in names if given[f"--{name}"] is not None}


def refuse_without(given: Given, needed: str, *options: str) -> None:
    """Refuse options that change nothing without one of others, named with spaces (InputError)."""
    named = named_options(given)
    if not named.keys() & set(needed.split()):
        refuse_idle(named, options, f"without {' or '.join(needed.split())}")


def refuse_beside(given: Given, chosen: str, *options: str) -> None:
    """Refuse options that change nothing beside another one, by name (InputError)."""
    named = named_options(given)
    if chosen in named:
        refuse_idle(named, options, f"with {named[chosen]}")


def named_options(given: Given) -> dict[str, str]:
    """The options that were given, or whose keys are set or varied by name, and other such keys, each as the
    user said it."""
    keys = {own.key: name for name, own in config_keys(Scenario()).items()}
    said = {
        keys.get(name, name): f"{by} {name}"
        for by in ("--vary", "--set")
        for word in given.get(by) or ()
        for name in [word.partition("=")[0].strip()]
    }
    return said | {name: name for name, value in given.items() if value is not None}


def refuse_idle_on_path(plan: PlanConfig, given: Given) -> None:
    """Refuse options the chosen pattern, or axis smoothing that is off, takes no notice of.

    Raises:
        InputError: Naming the first one and where it counts.
    """
    from polish_sim.planning import PATTERNS  # numpy is slow to import

    for option, own in config_keys(Scenario()).items():
        name = own.key.removeprefix("plan.")
        where = [of for of, pattern in PATTERNS.items() if name in pattern.listens]
        if where and given.get(option) is not None and plan.pattern in PATTERNS.keys() - where:
            raise InputError(
                f"{option} would change nothing with the pattern '{plan.pattern}': leave it out. "
                f"It counts for: {', '.join(sorted(where))}."
            )
    if given.get("--axis-deviation") is not None and plan.axis_smoothing_m == 0.0:
        raise InputError(
            "--axis-deviation bounds --axis-smoothing, which is off: give --axis-smoothing MM as well."
        )
