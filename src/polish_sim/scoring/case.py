"""What a case of the scorecard is, and who is scored in it: plain data (layer 10)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np

from polish_sim.config import Scenario
from polish_sim.errors import unknown_name
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override


class Entry(NamedTuple):
    """A controller that is scored."""

    label: str
    """What tables call it."""
    name: str
    """What the scenario calls it: a shipped controller, or ``FILE.py:CLASS`` with an absolute path."""
    settings: tuple[str, ...] = ()
    """``KEY=VALUE`` of the config that belong to it, e.g. gains."""


class Draw(NamedTuple):
    """A key of the config that every seed draws anew, evenly within a range."""

    key: str
    low: float
    high: float


@dataclass(frozen=True)
class Case:
    """One case: an experiment's default scenario with a few keys changed."""

    name: str
    text: str
    """What is run, in one line."""
    experiment: str
    """``force``: a hold, measured in its steady window; ``surface``: a path, measured while fed."""
    settings: tuple[str, ...] = ()
    """``KEY=VALUE`` of the config."""
    draws: tuple[Draw, ...] = ()
    repeats: int = 1
    """How many times as many seeds as the other cases it gets."""

    @property
    def moving(self) -> bool:
        """Whether the tool is fed along a path; else it holds one point."""
        return self.experiment == "surface"

    def scenario(self, entry: Entry, seed: int) -> Scenario:
        """The complete scenario of one row.

        Raises:
            ConfigError: If a setting does not fit the config.
        """
        rng = np.random.default_rng([seed, 0x5C0FE])
        drawn = [f"{draw.key}={rng.uniform(draw.low, draw.high)!r}" for draw in self.draws]
        scenario = override(default_scenario(self.experiment), [*self.settings, *drawn, *entry.settings])
        return replace(scenario, seed=seed, controller=replace(scenario.controller, name=entry.name))


def choose_cases(cases: Sequence[Case], wanted: Iterable[str]) -> tuple[Case, ...]:
    """Cases by name or shell pattern such as ``latency-*``, in the battery's order; all of them if none is named.

    Raises:
        InputError: If a name fits no case; lists the names.
    """
    chosen: set[str] = set()
    for pattern in wanted:
        fitting = {case.name for case in cases if fnmatchcase(case.name, pattern)}
        if not fitting:
            raise unknown_name("case", pattern, [case.name for case in cases])
        chosen |= fitting
    return tuple(case for case in cases if case.name in chosen or not chosen)
