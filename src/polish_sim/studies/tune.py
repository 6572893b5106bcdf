"""Search of a controller's parameters on cases of the score, judged on seeds and cases the search never saw.

A trial is scored on its cheap cases first, the holds; it is given up where they already break a condition,
or, of a goal that is the worst of all rows, where they are worse than the best trial.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from polish_sim.analysis.claim import Claim, shortfalls
from polish_sim.config import ControllerConfig
from polish_sim.control import CONTROLLERS
from polish_sim.control.laws import law_parameters
from polish_sim.errors import LARGEST, InputError, check_name, number_text, unknown_name
from polish_sim.row_file import Row
from polish_sim.scenario_file import is_number, section_keys
from polish_sim.scoring.battery import BATTERY, Case, Entry, choose_cases
from polish_sim.scoring.figures import FIGURES, STABLE
from polish_sim.scoring.score import Task, score_rows
from polish_sim.tables import number_in
from polish_sim.workers import Runner

SAMPLERS = ("tpe", "cmaes")
TRAINING = (
    "step-20",
    "approach-20",
    "stiffness-0.5",
    "stiffness-2",
    "latency-12",
    "noise-1",
    "flat-30",
)
"""The cases the search sees unless others are named; the rest of the battery is held out."""
HELD_OUT_SEED = 1000  #: The first seed the search does not see
#: Added to the goal of a trial that breaks a condition, beside the share of its rows that do
BROKEN = 1e6
#: A range that is not given goes from the shipped value by this to the shipped value times this
WIDE = 4.0
BY_LOG = 8.0  #: Ratio of a range's ends from which it is searched by logarithm


class Searched(NamedTuple):
    """A parameter that is searched."""

    key: str  #: Dotted, of the config
    low: float
    high: float
    shipped: float

    @property
    def log(self) -> bool:
        """Whether it is searched by logarithm."""
        return self.low > 0.0 and self.high / self.low >= BY_LOG


class Goal(NamedTuple):
    """What is made small: the worst or the mean of a figure over all rows."""

    how: str
    figure: str

    def of(self, rows: Sequence[Row]) -> float:
        """Its value; infinite where a run that should have the figure has none, NaN where none should."""
        known = [row[self.figure] for row in rows if _has(self.figure, row["case"])]
        values = [math.inf if value is None else float(value) for value in known]
        if not values:
            return math.nan
        return max(values) if self.how == "worst" else sum(values) / len(values)


_MOVING = {case.name: case.moving for case in BATTERY}
_OF_HOLDS, _OF_PATHS = ("settling_1n_s",), ("peaks_error_n", "slowed")


def _has(figure: str, case: str) -> bool:
    return figure not in (_OF_HOLDS if _MOVING[case] else _OF_PATHS)


@dataclass(frozen=True)
class Search:
    """What is searched, on what, and what is asked of it."""

    controller: str  #: Name, or ``FILE.py:CLASS`` with an absolute path
    over: tuple[Searched, ...]
    goal: Goal
    conditions: tuple[Claim, ...]
    cases: tuple[Case, ...]  #: The search sees these
    held_out: tuple[Case, ...]
    seeds: int
    settings: tuple[str, ...] = ()
    sampler: str = "tpe"

    def entry(self, values: Mapping[str, float] | None) -> Entry:
        """The controller with some values; None: as it ships."""
        sets = [f"{key}={value!r}" for key, value in (values or {}).items()]
        return Entry("shipped" if values is None else "tuned", self.controller, (*self.settings, *sets))

    def stages(self) -> list[list[Case]]:
        """The cases, cheap ones first."""
        holds, paths = [c for c in self.cases if not c.moving], [c for c in self.cases if c.moving]
        return [stage for stage in (holds, paths) if stage]

    def breaks(self, row: Row) -> bool:
        """Whether a row breaks a condition."""
        asked = [claim for claim in self.conditions if _has(claim.figure, row["case"])]
        return bool(shortfalls(asked, row))

    def judge(self, rows: Sequence[Row]) -> float:
        """The goal of some rows, or far more where they break a condition."""
        broken = sum(map(self.breaks, rows))
        value = self.goal.of(rows)
        return BROKEN * (1.0 + broken / len(rows)) if broken or not math.isfinite(value) else value


def read_over(controller: str, words: Sequence[str]) -> tuple[Searched, ...]:
    """The parameters that ``NAME`` or ``NAME=low:high`` name: those of an own class, else keys under
    ``controller``.

    A key is named by its beginning, as ``force_p`` for ``force_p_m_sn``.

    Raises:
        InputError: If a name is unknown or not a number's, or its range is missing or wrong.
    """
    shipped = controller in CONTROLLERS
    keys = {key: field for key, field, _ in section_keys(ControllerConfig())}
    known: Any = keys if shipped else law_parameters(controller)
    usual = {name: parameter for name, parameter in known.items() if is_number(parameter.default)}
    found = []
    for word in words:
        name, _, span = word.partition("=")
        near = [key for key in usual if key == name] or [key for key in usual if key.startswith(name + "_")]
        if len(near) != 1:
            raise unknown_name("parameter to tune", name, usual)
        value, spec = float(usual[near[0]].default), usual[near[0]].metadata
        low, high = spec["low"], spec["high"]
        least, most = _span(word, span) if span else _around(name, value, low, high, declared=not shipped)
        if not low <= least < most <= high:
            raise InputError(
                f"--over {word}: its range must be within {number_text(low)} to {number_text(high)}."
            )
        found.append(Searched(f"controller.{'' if shipped else 'own.'}{near[0]}", least, most, value))
    return tuple(found)


def _span(word: str, text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        raise InputError(f"--over {word} is not NAME or NAME=low:high, e.g. force_p=0.001:0.02.") from None
    return low, high


def _around(name: str, value: float, low: float, high: float, declared: bool) -> tuple[float, float]:
    if declared and low > -LARGEST and high < LARGEST:
        return low, high
    if declared or value <= 0.0:
        raise InputError(f"--over {name} needs a range, {name}=low:high: nothing says what it may be.")
    return max(low, value / WIDE), min(high, value * WIDE)


def read_goal(text: str) -> Goal:
    """``worst:FIGURE`` or ``mean:FIGURE``.

    Raises:
        InputError: If it is neither, or no figure of a score.
    """
    how, colon, figure = text.partition(":")
    if how not in ("worst", "mean") or not colon:
        raise InputError(f"--goal '{text}' is not worst:FIGURE or mean:FIGURE, e.g. worst:rms_error_n.")
    return Goal(how, _figure(figure, "goal"))


def read_condition(text: str) -> Claim:
    """``stable`` or ``FIGURE<=VALUE``.

    Raises:
        InputError: If it is neither, or no figure of a score.
    """
    if text == "stable":
        return STABLE
    name, _, number = text.partition("<=")
    figure, most = name.strip(), number_in(number)
    if math.isnan(most):
        raise InputError(f"--subject-to '{text}' is not stable or FIGURE<=VALUE, e.g. overshoot_n<=5.")
    return Claim(_figure(figure, "condition"), f"{figure}<={most:g}", "", high=most)


def _figure(name: str, what: str) -> str:
    known = [figure for figure in (*FIGURES, "peaks_error_n", "slowed") if figure != "stable"]
    check_name(f"figure of a {what}", name, known)
    return name


def training_cases(wanted: Sequence[str]) -> tuple[tuple[Case, ...], tuple[Case, ...]]:
    """The cases the search sees, by name or pattern (`TRAINING` if none is named), and those it does not."""
    seen = choose_cases(BATTERY, wanted or TRAINING)
    return seen, tuple(case for case in BATTERY if case not in seen)


def search_best(
    search: Search, trials: int, runner: Runner, heard: Callable[[int, str], None]
) -> dict[str, float]:
    """Search with a number of ``trials``, the shipped values first; the best values by key.

    The sampler of each trial is seeded by its number: a search that was interrupted makes the same trials
    again, whose rows are kept. ``heard`` gets each trial's number and how it went.

    Raises:
        InputError: If no trial keeps the conditions.
    """
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study()
    study.enqueue_trial({p.key: min(max(p.shipped, p.low), p.high) for p in search.over})
    for number in range(trials):
        study.sampler = (
            optuna.samplers.TPESampler(seed=number, n_startup_trials=10)
            if search.sampler == "tpe"
            else (optuna.samplers.CmaEsSampler(seed=number))
        )
        trial = study.ask()
        values = {p.key: trial.suggest_float(p.key, p.low, p.high, log=p.log) for p in search.over}
        value, whole = score_trial(search, values, _best_of(study), runner)
        state = optuna.trial.TrialState.COMPLETE if whole else optuna.trial.TrialState.PRUNED
        trial.report(value, 0)
        study.tell(trial, value if whole else None, state=state)
        how = "" if whole else "given up early: "
        heard(number + 1, f"{how}{_value_text(value)}; best {_value_text(_best_of(study))}")
    if not _best_of(study) < BROKEN:
        names = ", ".join(condition.figure for condition in search.conditions)
        raise InputError(
            f"no trial keeps what it is subject to ({names}) in all cases. Search wider, or ask less."
        )
    return dict(study.best_params)


def _best_of(study: Any) -> float:
    values = [trial.value for trial in study.trials if trial.state.name == "COMPLETE"]
    return min(values, default=math.inf)


def _value_text(value: float) -> str:
    return "not kept" if value >= BROKEN else number_text(value, 4)


def score_trial(
    search: Search, values: Mapping[str, float], best: float, runner: Runner
) -> tuple[float, bool]:
    """The goal of some values, and whether all cases were run for it."""
    rows: list[Row] = []
    stages, entry = search.stages(), search.entry(values)
    for number, cases in enumerate(stages):
        tasks = [Task(case, entry, seed) for case in cases for seed in range(search.seeds)]
        rows += _all_rows(runner, tasks).values()
        value = search.judge(rows) if rows else math.inf
        lost = value >= BROKEN or (search.goal.how == "worst" and value > best)
        if lost and number + 1 < len(stages):
            return value, False
    return value, True


def _all_rows(runner: Runner, tasks: Iterable[Task]) -> dict[Task, Row]:
    """The rows of tasks, of which a search needs all: Ctrl-C ends it."""
    rows = score_rows(runner, tasks, heard=lambda *_: None)
    if runner.interrupted:
        raise KeyboardInterrupt
    return rows


class Verdict(NamedTuple):
    """Shipped and tuned values on some cases and seeds."""

    what: str
    rows: int
    shipped: float  #: The goal, of the rows in which both keep the conditions
    tuned: float
    shipped_broken: int  #: Rows that break a condition
    tuned_broken: int

    @property
    def better(self) -> bool:
        """Whether the tuned values break fewer conditions, or no more and are better in the goal."""
        if self.tuned_broken != self.shipped_broken:
            return self.tuned_broken < self.shipped_broken
        return self.tuned < self.shipped


def judge_tuned(search: Search, best: Mapping[str, float], seeds: int, runner: Runner) -> list[Verdict]:
    """Shipped and tuned values side by side: where the search looked, on other seeds, and in other cases."""
    fresh = range(HELD_OUT_SEED, HELD_OUT_SEED + seeds)
    places = [
        ("seen by the search", search.cases, range(search.seeds)),
        ("held-out seeds", search.cases, fresh),
    ]
    if search.held_out:
        places.append(("held-out cases and seeds", search.held_out, fresh))
    verdicts = []
    for what, cases, chosen in places:
        shipped, tuned = (
            [Task(case, search.entry(values), seed) for case in cases for seed in chosen]
            for values in (None, best)
        )
        rows = _all_rows(runner, [*shipped, *tuned])
        pairs = [(rows[a], rows[b]) for a, b in zip(shipped, tuned, strict=True) if {a, b} <= rows.keys()]
        kept = [pair for pair in pairs if not any(map(search.breaks, pair))]
        before, after = (search.goal.of([pair[k] for pair in kept]) for k in (0, 1))
        broken = (sum(search.breaks(pair[k]) for pair in pairs) for k in (0, 1))
        verdicts.append(Verdict(what, len(pairs), before, after, *broken))
    return verdicts
