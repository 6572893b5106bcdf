"""`polish-sim run` and `demo`: simulate an experiment, once or over many seeds, beside the paper's
figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperGroup

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE, Outcome
from polish_sim.cli.catalogue import PanelledCommand, as_command
from polish_sim.cli.inspect import take_plan
from polish_sim.cli.options import (
    CONFIG_OPTIONS,
    OUTPUT_OPTIONS,
    Given,
    build_scenario,
    named_options,
    refuse_beside,
    refuse_idle_on_path,
    refuse_without,
    takes,
)
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.cli.pictures import CELL_PICTURE, save_cell_picture
from polish_sim.cli.view import live_address
from polish_sim.config import Checked, Scenario
from polish_sim.errors import InputError, place_in_mm
from polish_sim.experiments.registry import (
    ROWS,
    Experiment,
    check_experiment,
    claims_shown,
    default_scenario,
    experiment,
    refuse_idle_options,
    run_experiment,
)
from polish_sim.page import save_page
from polish_sim.row_file import METRICS, put_file, save_plots, write_json
from polish_sim.scenario_file import merge

if TYPE_CHECKING:
    from polish_sim.analysis.run_record import RunRecord
    from polish_sim.cell import Observer
    from polish_sim.cell.observer import Interrupt
    from polish_sim.cli.live_view import FrameSink
    from polish_sim.cli.progress import ProgressObserver
    from polish_sim.planning import PlanResult, ToolPath

# Feed and step-over such that the whole spiral is fed in less than 60 s.
DEMO = {"part": {"file": "freeform"}, "plan": {"stepover_m": 0.02}, "process": {"feed_m_s": 0.03}}
COMMON_OPTIONS = ("--check", *CONFIG_OPTIONS, *OUTPUT_OPTIONS)
OF_RUNS = ("--controller", "--part", "--path", "--fault")  #: Not every experiment takes them, nor their keys
PICTURES_MISSING = "pictures_missing"  #: In metrics.json, if interrupted while pictures were drawn


class RunGroup(TyperGroup):
    """The experiments as commands, each with the options it takes; a row loads when its command is asked
    for."""

    def list_commands(self, ctx: Any) -> list[str]:
        """The experiments in the order of the registry."""
        return list(ROWS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of one experiment.

        Raises:
            InputError: There is no such experiment.
        """
        row = experiment(cmd_name)
        return as_command(cmd_name, _command_of(row), row.text, ExperimentCommand)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take the experiment also where options stand before it."""
        named = next((word for word in args if word in ROWS), None)
        if named and not {"-h", "--help"} & set(args[: args.index(named)]):
            args.remove(named)
            args = [named, *args]
        elif not args:
            raise InputError(f"Missing EXPERIMENT: {', '.join(ROWS)}. See 'polish-sim run --help'.")
        return super().parse_args(ctx, args)


runs = typer.Typer(
    cls=RunGroup,
    add_completion=False,
    rich_markup_mode=None,
    options_metavar="",
    subcommand_metavar="EXPERIMENT [OPTIONS]",
)


@runs.callback()
def _every_run() -> None:
    """Simulate an experiment of the papers; 'polish-sim run EXPERIMENT --help' shows its options."""


class ExperimentCommand(PanelledCommand):
    """A run's command: options that change nothing in the experiment are refused by name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse what the experiment takes no notice of, then parse the rest."""
        row = experiment(str(self.name))
        named = {word.partition("=")[0] for word in args if word.startswith("--")} - set(COMMON_OPTIONS)
        refuse_idle_options(row, {name: name for name in named})
        return super().parse_args(ctx, args)


def _command_of(row: Experiment) -> Callable[..., int]:
    """The function behind `run` of one experiment."""

    def command(given: Given) -> int:
        return run(row, given)

    command.__doc__ = f"{row.text[:1].upper()}{row.text[1:]}."
    return takes(*row.options, *COMMON_OPTIONS, defaults=row.defaults)(command)


def run(row: Experiment, given: Given) -> int:
    """Simulate an experiment with the options given."""
    view = given.get("--view")
    seeds = given.get("--seeds")
    refuse_beside(given, "--seeds", "--view", "--live", "--video", "--learn")
    live = live_address(given)
    refuse_without(given, "--seeds", "--workers", "--on")
    if given.get("--video"):
        from polish_sim.cli.film import check_film

        check_film()
    scenario = build_scenario(row.defaults, given)
    plan, scenario = checked_run(scenario, given)
    if given.get("--dry-run"):
        check_reach(scenario, plan)
        return DONE
    if seeds:
        from polish_sim.cli.many import run_many

        return run_many(scenario, plan, {**given, "--seed": scenario.seed})
    refuse_taken(given, scenario.plan.file, scenario.process.learn, scenario.plan.removal)
    sinks: list[FrameSink] = []
    if view:
        from polish_sim.cli.live_view import Viewer

        sinks.append(Viewer())
    if live:
        from polish_sim.cli.live_view import LiveView

        sinks.append(LiveView(live, row.title(scenario)))
    return run_into(f"run-{row.name}", given, scenario, plan, sinks)


@takes(*OUTPUT_OPTIONS)
def demo(given: Given) -> int:
    """Plan a path on a shipped part and polish it under force control, with a short report."""
    from polish_sim.experiments.assembly import check

    scenario = check(merge(default_scenario("surface"), DEMO, ""))
    console.note(
        f"demo: polish the shipped part '{scenario.part.file}' at {scenario.process.contact_force_n:g} N"
    )
    code = run_into("demo", given, scenario, None)
    console.say("pictures and figures are in the folder; for more: polish-sim run --help")
    return code


def run_into(
    kind: str,
    given: Given,
    scenario: Checked,
    plan: ToolPath | None,
    sinks: Sequence[FrameSink] = (),
) -> int:
    """Run a scenario into an output folder of its own and show its outcome."""
    from polish_sim.cell.observer import results_kept

    with results_kept(waits=False) as again:
        with claimed(given, kind) as folder:
            outcome = run_once(scenario, plan, folder.draft, again, sinks, given.get("--video"))
        return outcome.finish(folder.final, given.get("--check"))


def checked_run(scenario: Scenario, given: Given) -> tuple[ToolPath | None, Checked]:
    """Refuse what cannot be run before anything is planned, and take the plan of a given path."""
    import polish_sim.cli.progress  # noqa: F401  (first: it quickens what the others import)
    from polish_sim.experiments.assembly import check

    row = experiment(scenario.experiment)
    refuse_idle_options(row, named_options(given))
    source = scenario.plan.file
    path = None
    if source and row.along_plan:
        path, scenario = take_plan(Path(source), scenario, given)
    elif source and "--path" not in row.options:
        raise InputError(f"'{row.name}' runs along no plan: leave plan.file out.")
    elif source:
        scenario = merge(scenario, {"plan": {"file": str(Path(source).resolve())}}, "")
    elif row.plans:
        refuse_idle_on_path(scenario.plan, given)
    return path, check(scenario, path)


def run_once(
    scenario: Checked,
    plan: ToolPath | None,
    draft: Path,
    again: Interrupt,
    sinks: Sequence[FrameSink],
    video: bool | None,
) -> Outcome:
    """Run a scenario, on a ``plan`` if one is given, and write its run folder into ``draft``; how it ended.

    Ctrl-C ``again`` after the run ends the drawing. ``sinks`` get the frames; with ``video`` a film is made.
    """
    from polish_sim.analysis.run_record import other_conditions, stop_mark

    row = experiment(scenario.experiment)
    record = None
    undrawn = ""
    try:
        with ExitStack() as stack:
            observer = stack.enter_context(console.progress(sinks))
            from polish_sim.experiments.report import page_of  # matplotlib, behind what quickens it

            for sink in sinks:
                stack.enter_context(sink)
            stack.enter_context(observer.compiling.ahead(scenario))
            planned, scenario = plan_to_run(scenario, plan, observer, draft)
            again.waits = True
            record = simulate(scenario, planned, draft, observer)
            again.waits = False
            if again.seen:
                raise KeyboardInterrupt
            observer.stage("draw")
            stop = stop_mark(record.metrics)
            model = observer.model
            draw_run(record, draft)
            save_page(draft, page_of(record, model, planned.notes if planned else ()))
            if stop and planned:
                from polish_sim.analysis.path_plot import plot_plan  # slow to import

                save_plots(draft, {"path.png": plot_plan(planned, stop=stop)})
            if len(record.log) and model and save_cell_picture(draft / CELL_PICTURE, record, model) and video:
                from polish_sim.cli.film import write_film

                observer.stage("film")
                write_film(draft, record, model, observer)
            again.waits = True
    except KeyboardInterrupt:
        if record is None:
            raise
        # The run itself is on disk by now and stays; only pictures are missing.
        undrawn = (
            "'polish-sim report' with the folder of the run draws them into a folder of its own"
            f"{', but no film' if video else ''}."
        )
        write_json(draft / METRICS, {**record.metrics, PICTURES_MISSING: True})
    figures = record.metrics
    return Outcome(
        claims_shown([scenario]),
        row.title(scenario),
        {"this run": figures},
        (figures["protective_stop"],) if figures["protective_stop"] else (),
        bool(figures["interrupted"]),
        undrawn,
        row.notes_of(figures, record.scenario),
        tuple(figures.get("bad_figures", ())),
        other_conditions(scenario, row.defaults),
    )


def simulate(
    scenario: Checked,
    plan: PlanResult | None,
    folder: Path,
    observer: ProgressObserver | None = None,
) -> RunRecord:
    """Run a scenario along its path and write config, figures, log and path into a folder.

    What was changed by hand while it ran is in the config as if it had been planned.
    """
    from polish_sim.analysis.run_record import write_record
    from polish_sim.cell.faults import as_planned

    result = run_experiment(scenario, plan, observer)
    record = result.record
    by_hand = observer.cell.asked if observer and observer.cell else ()
    record = replace(record, scenario=as_planned(record.scenario, by_hand))
    write_record(folder, record)
    for name, text in result.files.items():
        put_file(folder, name, text)
    return record


def draw_run(record: RunRecord, folder: Path) -> None:
    """Draw and save the pictures of a run, and its removal as a mesh."""
    from polish_sim.analysis.removal_plot import REMOVAL_MESH, write_removal_mesh
    from polish_sim.experiments.report import draw_plots

    save_plots(folder, draw_plots(record))
    if record.removal:
        write_removal_mesh(folder / REMOVAL_MESH, record.removal)


def check_reach(scenario: Checked, plan: ToolPath | None) -> None:
    """Plan and check the reach of a run, and say where the part stands; nothing is simulated or written.

    Raises:
        PolishSimError: If the part cannot be used, planned or reached.
    """
    with console.progress() as observer:
        path, reach, held = check_experiment(
            scenario, plan_to_run(scenario, plan, observer, None)[0], observer
        )
    console.say(f"path: {path.length_m:.3f} m, {len(path.s)} points, all within reach")
    if scenario.experiment != "arc":
        console.say(f"part: its origin stands at {place_in_mm(reach.T_base_work[:3, 3])} of the robot base")
    if held:
        console.say(f"part: {held}")
    console.say(f"smallest singular value on the way: {reach.smallest_singular_value:.3f}")


def plan_to_run(
    scenario: Checked, given: ToolPath | None, observer: Observer, folder: Path | None
) -> tuple[PlanResult | None, Checked]:
    """Plan the path of a run, or measure the one that is given, and prove it where it was not; None once
    around a rim.

    Without a ``folder`` for the plan's files and picture nothing is written or proven. The scenario comes
    back with the part where it was proven.

    Raises:
        PolishSimError: If the part cannot be used or planned.
    """
    row = experiment(scenario.experiment)
    if given is None and not row.is_planned(scenario.plan.removal):
        return None, scenario
    from polish_sim.analysis.path_plot import plot_plan
    from polish_sim.exchange import plan_facts, read_cuts, write_plan
    from polish_sim.experiments.even_removal import plan_removal
    from polish_sim.experiments.proof import prove_with_a_pad_that_fits
    from polish_sim.experiments.proof_record import drift_notes, proof_notes, why_not_proven
    from polish_sim.planning import measure_given_path

    source = Path(scenario.plan.file)
    if given is None:
        plan = plan_removal(scenario, observer)
    else:
        plan = measure_given_path(given, *scenario.planned_by, observer, read_cuts(source))
    if scenario.plan.begin_m > 0.0:
        plan = plan.behind(scenario.plan.begin_m)
    try:
        if folder and row.name == "surface" and scenario.safety.proof != "none":
            known = given and plan_facts(source).get("proof")
            if doubt := known and why_not_proven(scenario, plan.path, known):
                console.note(f"note: the plan's proof is {doubt}: it is proven again, as this run is set")
            if known and not doubt:
                notes = (
                    *plan.notes,
                    *proof_notes(known),
                    *drift_notes(scenario.process, scenario.sensor, plan),
                )
                plan = replace(plan, proof=known, notes=notes)
            else:
                plan, scenario = prove_with_a_pad_that_fits(scenario, plan, observer)
    finally:
        console.notes(plan.notes)
    if folder:
        write_plan(folder, plan)
        save_plots(folder, {"path.png": plot_plan(plan)})
    return plan, scenario
