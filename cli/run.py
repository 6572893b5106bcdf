"""`polish-sim run`: simulate an experiment, once or over many seeds, and show its figures beside the paper's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polish_sim.cli import console
from polish_sim.cli import option_types as o
from polish_sim.cli.boundary import DONE
from polish_sim.cli.idle_options import refuse_idle_in, refuse_idle_on_path
from polish_sim.cli.option_groups import (
    ConfigOptions,
    MasterOptions,
    OutputOptions,
    PatternOptions,
    RegionOptions,
    ToolOptions,
    takes_groups,
)
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.cli.rendering import prepare_headless
from polish_sim.cli.scenario_options import build_scenario, given_options
from polish_sim.cli.sinks import open_sinks
from polish_sim.config import Scenario
from polish_sim.errors import InputError

if TYPE_CHECKING:
    from polish_sim.planning import ToolPath


@dataclass(frozen=True)
class WorkpieceOptions:
    """The part in the cell."""

    part: o.Part = None
    real_part: o.RealPart = None
    part_pose: o.PartPose = None


@dataclass(frozen=True)
class PathOptions(PatternOptions):
    """How a path is planned; the hand of ``teach`` has a direction, too."""

    direction: o.DirectionInRun = None


@dataclass(frozen=True)
class JobOptions:
    """What one experiment or another has beside the path: spindle, stand-off, guiding hand."""

    spindle_rpm: o.SpindleSpeed = None
    standoff: o.Standoff = None
    mode: o.Mode = None
    duration: o.Duration = None
    follow: o.Follow = None


@dataclass(frozen=True)
class TrialOptions:
    """Who controls, what is drawn at random or goes wrong, and what is done with the run."""

    controller: o.Controller = None
    calibration: o.Calibration = None
    seed: o.Seed = None
    seeds: o.Seeds = None
    fault: o.Faults = None
    dry_run: o.DryRun = False
    check: o.Check = False
    view: o.View = False


@dataclass(frozen=True)
class RecordOptions:
    """What is kept of the run."""

    video: o.Video = False
    log_rate: o.LogRate = None


@takes_groups
def run(
    experiment: o.Experiment,
    *,
    workpiece: WorkpieceOptions,
    region: RegionOptions,
    path: o.PathFile = None,
    pattern: PathOptions,
    tool: ToolOptions,
    master: MasterOptions,
    job: JobOptions,
    trial: TrialOptions,
    settings: ConfigOptions,
    record: RecordOptions,
    output: OutputOptions,
) -> int:
    """Simulate an experiment of the papers: arc, force, surface, smooth, teach or dual."""
    given = given_options(workpiece, region, pattern, tool, master, job, trial, record)
    view, video, seeds = trial.view, record.video, trial.seeds
    switches = {"--view": view or None, "--video": video or None, "--dry-run": trial.dry_run or None}
    refuse_idle_in(experiment, given | {"--seeds": seeds, "--path": path} | switches)
    if seeds is not None and (view or video):
        raise InputError("--view and --video show one run: leave --seeds out.")
    refuse_taken(output.out, output.overwrite)
    prepare_headless()
    # Lazy: the simulator takes a second to load, --help must not wait for it.
    from polish_sim.cli.seeds import run_seeds
    from polish_sim.cli.simulation import check_reach, run_once
    from polish_sim.experiments.registry import default_scenario

    scenario = build_scenario(default_scenario(experiment), given, settings.config, settings.set_ or [])
    plan, scenario = _checked(scenario, given, path)
    if trial.dry_run:
        check_reach(scenario, plan)
        return DONE
    with claimed(output.out, f"run-{experiment}", output.overwrite) as folder:
        if seeds is None:
            outcome = run_once(scenario, plan, folder.draft, open_sinks(folder.draft, view, video))
        else:
            outcome = run_seeds(scenario, plan, range(scenario.seed, scenario.seed + seeds), folder.draft)
    outcome.show()
    console.say(f"folder: {folder.final}")
    return outcome.exit_code(trial.check)


def _checked(scenario: Scenario, given: Mapping[str, Any], path: Path | None) -> tuple[ToolPath | None, Scenario]:
    """Refuse what cannot be run before anything is planned, and take the plan of a given path."""
    from polish_sim.cli.given_plan import name_path, take_plan
    from polish_sim.experiments.assembly import check_force, check_settings
    from polish_sim.experiments.registry import experiment as row_of
    from polish_sim.planning import PATTERNS

    source = path or (Path(scenario.plan.file) if scenario.plan.file else None)
    row = row_of(scenario.experiment)
    check_settings(scenario, plans=row.plans and source is None)
    given_path = None
    if scenario.experiment == "smooth":
        scenario = scenario if source is None else name_path(source, scenario)
    elif source is not None:
        given_path, scenario = take_plan(source, scenario, given)
    elif row.plans:
        refuse_idle_on_path(scenario.plan, {name: known.listens for name, known in PATTERNS.items()}, given)
    check_force(scenario, given_path)
    return given_path, scenario
