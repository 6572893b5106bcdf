"""A study: what is varied, how it is sampled, and the runs that makes (words or study.toml -> Study ->
runs)."""

from __future__ import annotations

import itertools
import math
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from polish_sim.analysis.run_record import changed_words
from polish_sim.config import Scenario
from polish_sim.config.key import key
from polish_sim.errors import ConfigError, InputError, check_name, first_twice, named_place
from polish_sim.experiments.registry import default_scenario
from polish_sim.scenario_file import counted_seeds, leaves, merge, override, parse_value, section_keys
from polish_sim.tables import number_in
from polish_sim.toml_text import read_toml, toml_text, toml_value

STUDY = "study.toml"
SAMPLES = ("grid", "random", "sobol", "lhs")
MOST_RUNS = 10_000_000
_RANGE = re.compile(r"([^:,\s]+):([^:,\s]+)(?::(lin|log)(\d*))?")


class Axis(NamedTuple):
    """One setting that is varied: over values, or over a range."""

    key: str  #: Dotted, as in ``--set``
    text: str  #: As it was written behind the key
    values: tuple[Any, ...]  #: Of a grid; of a range without a count empty
    low: float = math.nan  #: Ends of a range, else NaN
    high: float = math.nan
    log: bool = False

    def at(self, share: float) -> Any:
        """The value at a share of the axis, 0 to below 1."""
        if math.isnan(self.low):
            return self.values[int(share * len(self.values))]
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + (self.high - self.low) * share)


class StudyRun(NamedTuple):
    """One run of a study."""

    values: tuple[Any, ...]  #: In the order of the axes
    seed: int


@dataclass(frozen=True)
class Study:
    """An experiment, its settings, and what is varied."""

    base: Scenario
    axes: tuple[Axis, ...]
    seeds: int = 1
    sample: str = "grid"
    count: int = 0  #: Points of a sample; of a grid 0
    said: tuple[str, ...] = ()  #: ``KEY=VALUE`` of the settings of its file

    def points(self) -> list[tuple[Any, ...]]:
        """The values of each point, in the order of the axes."""
        if self.sample == "grid":
            return list(itertools.product(*(axis.values for axis in self.axes)))
        return [tuple(axis.at(u) for axis, u in zip(self.axes, row, strict=True)) for row in self._shares()]

    def runs(self) -> Iterator[StudyRun]:
        """Every point with every seed; neighbours share a seed, and so the part it draws."""
        points = self.points()
        for seed in counted_seeds(self.base.seed, self.seeds):
            yield from (StudyRun(values, seed) for values in points)

    def scenario(self, run: StudyRun) -> Scenario:
        """The complete scenario of a run.

        Raises:
            ConfigError: If a value does not fit its key.
        """
        sets = [f"{axis.key}={toml_value(value)}" for axis, value in zip(self.axes, run.values, strict=True)]
        return replace(override(self.base, sets), seed=run.seed)

    def with_value(self, axis: Axis, value: Any) -> Scenario:
        """The base with one value of one axis; ConfigError if it does not fit its key."""
        return override(self.base, [f"{axis.key}={toml_value(value)}"])

    def check(self) -> None:
        """Refuse what no run could be made of, before any is.

        Raises:
            PolishSimError: Naming the axis, the value or the option.
        """
        check_name("sample", str(self.sample), SAMPLES)
        keys = [axis.key for axis in self.axes]
        if twice := first_twice(keys):
            raise InputError(f"'{twice}' is varied twice: give one --vary.")
        if "seed" in keys:
            raise InputError("a study counts seeds with --seeds: vary something else.")
        if self.sample == "grid" and self.count:
            raise InputError(
                "--count is for --sample random, sobol or lhs: a grid has as many points as its axes make."
            )
        if self.sample != "grid" and not self.count:
            raise InputError(f"--sample {self.sample} needs --count N, the number of points.")
        for axis in self.axes:
            if self.sample == "grid" and not axis.values:
                ends = ":".join(axis.text.split(":")[:2])
                raise InputError(
                    f"--vary {axis.key}={axis.text}: a grid needs steps, e.g. {axis.key}={ends}:lin5."
                )
        seeds = len(counted_seeds(self.base.seed, self.seeds))
        count = seeds * (self.count or math.prod(len(axis.values) for axis in self.axes))
        if count > MOST_RUNS:
            raise InputError(f"that makes {count} runs, more than {MOST_RUNS}. Give fewer values or seeds.")
        for axis in self.axes:
            for value in axis.values or (axis.low, axis.high):
                self.with_value(axis, value)

    def _shares(self) -> Any:
        """Points of the unit cube, shape (count, axes); the same again for the same first seed."""
        import numpy as np
        from scipy.stats import qmc

        rng, dims = np.random.default_rng(self.base.seed), len(self.axes)
        if self.sample == "random":
            return rng.random((self.count, dims))
        if self.sample == "lhs":
            return qmc.LatinHypercube(dims, rng=rng).random(self.count)
        # Drawn to the next power of two, which is what makes them even, and cut.
        return qmc.Sobol(dims, rng=rng).random_base2(max(0, math.ceil(math.log2(self.count))))[: self.count]


def read_axis(text: str) -> Axis:
    """``KEY=a,b,c``, ``KEY=[a, b]`` (TOML), ``KEY=low:high:lin5``, ``:log5``; ``KEY=low:high`` of samples
    only.

    Raises:
        InputError: If it is none of that.
    """
    key, equals, values = text.partition("=")
    key, values = key.strip(), values.strip()
    if not equals or not key or not values.strip(", []"):
        raise InputError(
            f"'--vary {text}' is not KEY=VALUES, e.g. sensor.force_noise_n=0.1,0.5 or "
            "controller.force_p_m_sn=0.001:0.01:log5."
        )
    found = _RANGE.fullmatch(values)
    low, high = map(number_in, found.group(1, 2) if found else ("", ""))
    if found and low == low and high == high:  # of words that only look like a range, e.g. mine.py:Mine, NaN
        return _range_of(key, values, low, high, found[3] == "log", int(found[4] or 0))
    if values.startswith("["):
        try:
            listed = tomllib.loads(f"v = {values}")["v"]
        except ValueError as error:
            raise InputError(f"'--vary {text}' is no list: {error}.") from error
        return Axis(key, values, _frozen(listed))
    words = [word.strip() for word in values.split(",")]
    if not all(words):
        raise InputError(f"'--vary {text}' has an empty value: leave the comma out.")
    return Axis(key, values, tuple(map(parse_value, words)))


def _range_of(key: str, text: str, low: float, high: float, log: bool, count: int) -> Axis:
    if not low < high or not math.isfinite(high - low):
        raise InputError(f"--vary {key}={text}: the first number must be less than the second.")
    if log and low <= 0.0:
        raise InputError(f"--vary {key}={text}: a range by log begins above 0.")
    if count == 1 or count > 1e6:
        raise InputError(f"--vary {key}={text}: {count} steps; write 2 to 1000000.")
    axis = Axis(key, text, (), low, high, log)
    # A last share of 1 gives the end itself, whatever the roundings.
    steps = (
        tuple(axis.at(k / (count - 1)) if k < count - 1 else high for k in range(count)) if count > 1 else ()
    )
    return axis._replace(values=tuple(float(f"{value:.12g}") for value in steps))


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


# A study as a file.


@dataclass(frozen=True)
class StudyHead:
    """A study but for its settings and what is varied."""

    experiment: str = key("", "as of run")
    seeds: int = key(1, "of each point", 1)
    first_seed: int = key(0, "they are counted up from it", 0)
    sample: str = key("grid", "grid, random, sobol or lhs")
    count: int = key(0, "points of a sample; 0 for a grid", 0)


def study_text(study: Study) -> str:
    """The study as study.toml."""
    usual = default_scenario(study.base.experiment)
    if study.base.plan.file:  # what its plan may say otherwise is always written
        process = replace(usual.process, contact_force_n=math.nan, feed_m_s=math.nan)
        usual = replace(usual, process=process, pad=replace(usual.pad, radius_m=math.nan))
    words = changed_words(replace(study.base, seed=0), replace(usual, seed=0))
    settings = {key: parse_value(value) for key, _, value in (word.partition("=") for word in words)}
    head = StudyHead(study.base.experiment, study.seeds, study.base.seed, study.sample, study.count)
    return toml_text(
        {
            **vars(head),
            "settings": settings,
            "vary": {
                axis.key: axis.text if not math.isnan(axis.low) else list(axis.values) for axis in study.axes
            },
        },
        {
            **{name: field.metadata["text"] for name, field, _ in section_keys(head)},
            "settings": "what differs from the experiment's defaults",
            "vary": 'lists, or "low:high:log5", "low:high:lin5"',
        },
        ["A sweep: polish-sim sweep study.toml continues it, adds what was added here, and repeats nothing."],
    )


def read_study(file: Path) -> Study:
    """Read a study.toml, strict on its keys.

    Raises:
        PolishSimError: If it cannot be read, or names what is not known.
    """
    table = read_toml(file, "study", InputError)
    sections = [table.pop(name, {}) for name in ("settings", "vary")]
    with named_place(f"'{file}'"):
        if not all(isinstance(section, dict) for section in sections):
            raise ConfigError(
                "'settings' and 'vary' are sections: write [settings] or [vary] and keys below."
            )
        head = merge(StudyHead(), table, "")
        settings, vary = map(leaves, sections)
        said = tuple(f"{name}={toml_value(value)}" for name, value in settings)
        base = override(replace(default_scenario(head.experiment), seed=head.first_seed), said)
        axes = tuple(_axis_of(name, value) for name, value in vary)
    return Study(base, axes, head.seeds, head.sample, head.count, said)


def _axis_of(name: str, value: Any) -> Axis:
    if isinstance(value, str):
        return read_axis(f"{name}={value}")
    if not isinstance(value, list) or not value:
        raise ConfigError(f"'{name}' under [vary] must be a list of values or a text such as '0.1:1:log5'.")
    return Axis(name, toml_value(value), _frozen(value))
