"""The experiments by name: one row each, which says what it runs, shows, is asked and takes.

Rows hold no heavy code: what runs, checks and draws is named as ``module:function`` and loaded when it is
needed, so that help answers at once and one experiment never loads another.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from polish_sim.analysis.claim import Claim
from polish_sim.config import Scenario
from polish_sim.errors import InputError, check_name, refuse_idle

if TYPE_CHECKING:
    from polish_sim.analysis.run_record import Records, RunRecord
    from polish_sim.cell import Observer
    from polish_sim.cell.faults import Fault
    from polish_sim.control import Controller
    from polish_sim.experiments.placement import Reach
    from polish_sim.experiments.result import RunResult
    from polish_sim.planning import PlanResult, ToolPath

ROWS: Mapping[str, str] = {
    "arc": "polish_sim.experiments.rows:ARC",
    "force": "polish_sim.experiments.rows:FORCE",
    "surface": "polish_sim.experiments.rows:SURFACE",
    "smooth": "polish_sim.smoothing:SMOOTH",
    "teach": "polish_sim.hand_guiding:TEACH",
    "dual": "polish_sim.dual:DUAL",
}
"""Where the row of each experiment is; a branch is known by this name only."""

REGION_OPTIONS = ("--region", "--feature-angle", "--edge-margin", "--hole-margin")
PART_OPTIONS = ("--part", "--part-pose", "--units", "--up")
REMOVAL_OPTIONS = ("--even-removal", "--removal")
COVER_OPTIONS = (
    "--pattern",
    "--stepover",
    "--overlap",
    "--order",
    "--direction",
    "--start",
    "--raster-direction",
    "--overrun",
    "--avoid",
    "--lead-in",
    "--lead-angle",
    "--tilt-angle",
    "--axis-smoothing",
    "--axis-deviation",
)
"""How a path covers a region."""
PATH_OPTIONS = (*REGION_OPTIONS, *COVER_OPTIONS, *REMOVAL_OPTIONS)
"""What decides where a planned path runs."""
FLANGED, POSITION = ("surface", "force"), "position"
"""Experiments an active flange takes part in, and the shipped controller of the arm behind it."""
TOOL_OPTIONS = ("--pad-diameter", "--contact-force", "--spindle-rpm")
SEED_OPTIONS = ("--seed", "--seeds", "--workers", "--on")
TRIAL_OPTIONS = ("--controller", "--calibration", *SEED_OPTIONS, "--fault", "--dry-run")
WATCH_OPTIONS = ("--view", "--live", "--live-port", "--live-host", "--video", "--log-rate")


class Setting(NamedTuple):
    """What a run was asked, as a row of a table."""

    label: str
    unit: str
    shown: Callable[[Scenario], str]
    where: str = "name"  #: Field of the experiment's row that is true where it has an effect


@dataclass(frozen=True)
class Experiment:
    """One experiment. A function is named ``module:function``."""

    name: str
    text: str  #: What it is, in one line
    defaults: Scenario
    run: str  #: (scenario, observer) or, where it runs along a plan, (scenario, plan, observer) -> RunResult
    claims: Callable[[Scenario], tuple[Claim, ...]]  #: The figures shown of a run, and what is asked of them
    #: Pictures of one run: by file name, (RunRecord) -> Figure
    plots: Callable[[RunRecord], Mapping[str, str]]
    #: Pictures of several runs side by side: by file name, (RunRecords) -> Figure
    comparisons: Mapping[str, str]
    #: Options of ``run`` that change something here, besides checks, config and output
    options: tuple[str, ...]
    settings: tuple[Setting, ...] = ()  #: Its own, beside ``SETTINGS``
    path_name: str = ""  #: Of the path that is planned; empty: its pattern
    check: str = ""  #: (scenario) -> None: refuses settings of its own that cannot be run; empty: none
    #: Arguments as of ``run`` -> what has the fields of CheckedPath: everything but the simulation; empty:
    #: nothing to check
    prepare: str = ""
    along_plan: bool = False  #: Whether it can run along a finished plan
    plans: bool = (
        False  #: Whether a plan is made before it where none is given, and a fixture may hold the part
    )
    paper: Mapping[str, Any] = field(default_factory=dict)
    """Settings that make a run the paper's own trial, so that the paper's figures stand beside it."""
    only_with: Mapping[tuple[str, ...], tuple[str, ...]] = field(default_factory=dict)
    """Options that change something beside one of several others only, by those."""
    not_with: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Options that change nothing beside another one, by that."""
    #: What its own figures that are not one number look like, beside `run_record.FORMS`
    forms: Mapping[str, Any] = field(default_factory=dict)
    #: More pictures of many seeds, as ``comparisons``
    seeds_plots: Mapping[str, str] = field(default_factory=dict)
    title: Callable[[Scenario], str] = lambda s: f"{s.experiment}, {s.controller.label}, seed {s.seed}"
    notes: str = ""  #: (figures, scenario) -> lines to print beside the table of a run; empty: none
    controlled: bool = True  #: Whether a controller drives the cell
    on_part: bool = True  #: Whether there is a part to press on
    carried: bool = False  #: Whether a second robot carries the part
    remade: bool = True  #: Whether the cell of a run can be set up again from what it left
    band_n: float = 0.0  #: In which the force is to stay about what is set [N]; 0: none
    faults: str = "polish_sim.cell.faults:FAULTS"  #: What can go wrong in its cell, Faults by name
    holds: bool = False  #: Whether the tool stays on one point, instead of being fed along the path
    #: Sections of the scenario that change nothing
    idle: tuple[str, ...] = ("guide", "hand", "drag", "dual")

    @property
    def fed(self) -> bool:
        """Whether a controller feeds the tool along a path."""
        return self.controlled and not self.holds

    def notes_of(self, figures: Mapping[str, Any], scenario: Scenario) -> list[str]:
        """What a run's terminal and page note beside its figures."""
        notes = [
            *(load(self.notes)(figures, scenario) if self.notes else ()),
            *(
                f"{event} did not happen: the run was over after {figures['simulated_s']:.1f} s."
                for event in figures.get("faults_missed", ())
            ),
        ]
        if scenario.process.changes:
            notes.append(
                f"set points were changed during the run ({scenario.process.changes}): figures of force and "
                "feed compare it with what was planned before."
            )
        return notes

    def is_planned(self, removal: str) -> bool:
        """Whether a run without a path has one planned by pattern, with this ``plan.removal``."""
        return self.plans or (self.along_plan and bool(removal))


def always(value: Any) -> Callable[[Any], Any]:
    """A value that is the same for every run."""
    return lambda _: value


def load(name: str) -> Any:
    """What stands under ``module:name``."""
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)


@cache
def experiment(name: str) -> Experiment:
    """The row of an experiment.

    Raises:
        InputError: If there is no such experiment; lists the known ones.
    """
    check_name("experiment", name, ROWS)
    row = load(ROWS[name])
    assert isinstance(row, Experiment)
    return row


def experiments() -> dict[str, Experiment]:
    """All rows by name."""
    return {name: experiment(name) for name in ROWS}


def known_faults() -> dict[str, Fault]:
    """The faults of all experiments by name."""
    return {name: fault for row in experiments().values() for name, fault in load(row.faults).items()}


def default_scenario(name: str) -> Scenario:
    """The scenario an experiment starts from.

    Raises:
        InputError: If there is no such experiment; lists the known ones.
    """
    return experiment(name).defaults


def once_more(scenario: Scenario) -> str:
    """The command that runs a scenario, with every setting in which it differs from its experiment's usual
    one."""
    from polish_sim.analysis.run_record import changed_words  # numpy is slow to import

    name = scenario.experiment
    changed = (f"--set {shlex.quote(text)}" for text in changed_words(scenario, default_scenario(name)))
    return " ".join([f"polish-sim run {name}", *changed])


class CheckedPath(NamedTuple):
    """A path and how the arm does all of it."""

    path: ToolPath
    reach: Reach
    held: str = ""  #: How a second robot holds the part, for the user


def check_experiment(
    scenario: Scenario, plan: PlanResult | None = None, observer: Observer | None = None
) -> CheckedPath:
    """Plan the path of an experiment and check that the arm can do it, without simulating anything.

    ``plan`` is one made before, where the experiment runs along one; planned if not given. The path of
    ``arc`` is in the base frame, others are in the work frame.

    Raises:
        PolishSimError: If the scenario cannot be run.
    """
    row = experiment(scenario.experiment)
    if not row.prepare:
        raise InputError(f"'{row.name}' has no path to check: run it.")
    found = _call(row, row.prepare, scenario, plan, observer)
    return CheckedPath(found.path, found.reach, found.held)


def run_experiment(
    scenario: Scenario,
    plan: PlanResult | None = None,
    observer: Observer | None = None,
    controller: Controller | None = None,
) -> RunResult:
    """Run the experiment a scenario names, on a ``plan`` made before if one is given.

    ``controller`` is used instead of the one the scenario names: any object with ``reset`` and ``step``. A
    protective stop or an interrupt is noted in the finished run, not raised.

    Raises:
        PolishSimError: If the scenario cannot be run.
    """
    if controller is not None:
        from polish_sim.control.laws import GivenController  # the control laws are slow to import

        scenario = replace(scenario, controller=GivenController.of(controller, scenario.controller))
    row = experiment(scenario.experiment)
    result: RunResult = _call(row, row.run, scenario, plan, observer)
    return result


def _call(
    row: Experiment, name: str, scenario: Scenario, plan: PlanResult | None, observer: Observer | None
) -> Any:
    checked = load("polish_sim.experiments.assembly:check")(scenario, plan and plan.path)
    looking_on = () if observer is None else (observer,)
    asked = (checked,)
    if row.along_plan:
        asked = load("polish_sim.experiments.even_removal:planned")(checked, plan, *looking_on)
    return load(name)(*asked, *looking_on)


def check_flange(scenario: Scenario, where: str = "") -> None:
    """Refuse an active flange where nothing lets it hold the force, in an experiment or ``where`` else.

    Raises:
        InputError: Naming the place, or the controller that would hold the force as well.
    """
    name = scenario.controller.name
    where = where or scenario.experiment
    if not scenario.head.flange.bandwidth_hz:
        return
    if where not in FLANGED:
        raise InputError(
            f"an active flange (head.flange.bandwidth_hz, --tool) is for 'run {' and '.join(FLANGED)}' and "
            f"jobs: leave it out of '{where}'."
        )
    if name != POSITION and ":" not in name:
        raise InputError(
            f"the active flange holds the force, and the controller '{name}' would do so as well: set "
            f"controller.name to {POSITION} (--controller {POSITION}) or to your own FILE.py:CLASS."
        )


def claims_shown(scenarios: Sequence[Scenario]) -> tuple[Claim, ...]:
    """The figures to show of runs of one experiment: what is asked of all of them alike.

    The paper's figures are left out unless every run is the paper's trial.
    """
    rows = [experiment(scenario.experiment) for scenario in scenarios]
    asked: dict[str, Claim] = {}
    for row, scenario in zip(rows, scenarios, strict=True):
        for claim in row.claims(scenario):
            before = asked.get(claim.figure, claim)
            alike = (claim.low, claim.high) == (before.low, before.high)
            asked[claim.figure] = claim if alike else claim._replace(low=-math.inf, high=math.inf)
    papers = all(
        attrgetter(name)(scenario) == value
        for row, scenario in zip(rows, scenarios, strict=True)
        for name, value in row.paper.items()
    )
    return tuple(claim if papers else claim._replace(paper="-") for claim in asked.values())


def path_words(scenario: Scenario) -> str:
    """The path of a run: its file's name, or how it was planned."""
    planned = experiment(scenario.experiment).path_name or scenario.plan.pattern
    return Path(scenario.plan.file).name or planned


SETTINGS = (
    Setting("part", "", lambda s: Path(s.part.file).name, "on_part"),
    Setting("path", "", path_words, "along_plan"),
    # Unknown for a path that is no plan of ours.
    Setting(
        "step-over",
        "mm",
        lambda s: f"{1e3 * s.plan.stepover_m:.4g}" if Path(s.plan.file).suffix in ("", ".json") else "-",
        "plans",
    ),
    Setting("set force", "N", lambda s: f"{s.process.contact_force_n:g}", "on_part"),
    Setting("feed", "mm/s", lambda s: f"{1e3 * s.process.feed_m_s:g}", "fed"),
    Setting("controller", "", lambda s: Path(s.controller.name).name, "controlled"),
    Setting("seed", "", lambda s: str(s.seed)),
)


def setting_rows(records: Records) -> list[list[str]]:
    """Rows of label, unit and a value for each run of one experiment: what was asked, and at the end how the
    run ended."""
    from polish_sim.analysis.run_record import ending  # numpy is slow to import

    row = experiment(records[0].scenario.experiment)
    rows = [
        [setting.label, setting.unit, *(setting.shown(record.scenario) for record in records)]
        for setting in (*row.settings, *SETTINGS)
        if getattr(row, setting.where)
    ]
    return [*rows, ["ended", "", *map(ending, records)]]


def refuse_idle_options(row: Experiment, named: Mapping[str, str], command: str = "") -> None:
    """Refuse options of other experiments, and keys of idle sections, that change nothing in one; ``named``:
    as the user said each.

    Raises:
        InputError: Naming them and why.
    """
    known = {*row.idle, *(option for other in experiments().values() for option in other.options)}
    some = {name: said for name, said in named.items() if {name, name.partition(".")[0]} & known}
    for option, others in row.not_with.items():
        if option in named:
            refuse_idle(some, others, f"with {named[option]}")
    for options, others in row.only_with.items():
        if not named.keys() & set(options):
            refuse_idle(some, others, f"without {' or '.join(options)}")
    where = f"in '{command or f'run {row.name}'}'"
    refuse_idle(some, sorted(some.keys() - set(row.options)), where)
