"""`polish-sim plan`: from a part's mesh to a tool path, with its figures and a picture."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE, STOPPED
from polish_sim.cli.options import (
    CONFIG_OPTIONS,
    OUTPUT_OPTIONS,
    Given,
    argument,
    build_scenario,
    named_options,
    refuse_beside,
    refuse_idle_on_path,
    refuse_without,
    takes,
)
from polish_sim.cli.output_folder import claimed, refuse_taken
from polish_sim.config import Checked, Scenario
from polish_sim.errors import PlanError, ReachError, place_in_mm
from polish_sim.experiments.registry import PATH_OPTIONS, check_flange, experiment, refuse_idle_options
from polish_sim.page import Table, number_or_dash, save_page
from polish_sim.row_file import save_plots, write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from polish_sim.cell import Observer
    from polish_sim.experiments.part_pose import PartPlacing
    from polish_sim.experiments.placement import Reach
    from polish_sim.experiments.setups import Patch, SetupSearch
    from polish_sim.planning import PlanResult

PAIR_OPTIONS = ("--master-speed", "--master-turn", "--master-path")  #: Only for a plan for two robots
ALL = "all"  #: The region that is split into setups
PartFile = Annotated[
    str,
    argument("PART", "STL, PLY, OBJ or STEP file, or the name of a shipped part."),
]


@takes(
    "--part-pose",
    "--units",
    "--up",
    "--fixture",
    *PATH_OPTIONS,
    "--tool",
    "--pad-diameter",
    "--contact-force",
    "--feed",
    "--dual",
    *PAIR_OPTIONS,
    "--controller",
    "--proof",
    "--seed",
    "--reach-map",
    *CONFIG_OPTIONS,
    "--export",
    *OUTPUT_OPTIONS,
)
def plan(part: PartFile, given: Given) -> int:
    """Plan a tool path on a part: path.csv, path.json, metrics.json and path.png.

    With --region all every side is planned, in as few setups as possible: a folder each, and a table.
    """
    dual = bool(given["--dual"])
    refuse_beside(given, "--dual", "--reach-map", "--proof")
    given = {**given, "--part": part}
    refuse_without(given, "--dual", *PAIR_OPTIONS)
    row = experiment("dual" if dual else "surface")
    refuse_idle_options(row, named_options(given), "plan")
    asked = build_scenario(Scenario(experiment=row.name), given)
    refuse_taken(given, asked.plan.removal)
    import polish_sim.cli.progress  # noqa: F401  (first: it quickens what the others import)
    from polish_sim.exchange import check_formats
    from polish_sim.experiments.assembly import check
    from polish_sim.experiments.setups import SetupSearch

    refuse_idle_on_path(asked.plan, given)
    formats = check_formats(given["--export"] or [])
    scenario = check(asked)
    if "urscript" in formats:
        check_flange(scenario, "--export urscript")
    with claimed(given, "plan") as folder, console.progress() as observer:
        if scenario.plan.region == ALL and not dual and not scenario.part.pose:
            show = plan_setups(SetupSearch(scenario, observer), folder.draft, given, observer)
            unreached = ""
        else:
            result, unreached = plan_once(scenario, folder.draft, given, observer)
            show = partial(_show_plan, result, unreached, dual)
    show()
    console.say_folder(folder.final)
    if (folder.final / "setup_1").is_dir():
        console.say(f"run each: polish-sim run surface --path {folder.final / 'setup_1'}")
    return STOPPED if unreached else DONE


def plan_once(
    scenario: Checked, folder: Path, given: Given, observer: Observer, forced: bool = True
) -> tuple[PlanResult, str]:
    """Plan one path into a folder, with the exports and the map ``given``; it and why the robot cannot do it:
    nothing is written then unless ``forced``."""
    from polish_sim.analysis.metrics import faults_of_plan
    from polish_sim.analysis.path_plot import plot_plan
    from polish_sim.exchange import ExportSetup, export_plan, write_plan
    from polish_sim.exchange.viewers import path_page
    from polish_sim.experiments.cycle import cycle_strokes, time_figures
    from polish_sim.experiments.even_removal import plan_removal
    from polish_sim.experiments.part_pose import PartPlacing
    from polish_sim.experiments.proof import prove_with_a_pad_that_fits
    from polish_sim.experiments.run_page import plan_page

    dual = scenario.experiment == "dual"
    result = plan_for_two(scenario, observer) if dual else plan_removal(scenario, observer)
    plots: dict[str, Figure] = {}
    begin = time.perf_counter()
    reach = None
    unreached = ""
    if not dual:
        observer.stage("place the part")
        placing = PartPlacing(scenario, *result.standing, result.path)
        reach, unreached = find_place(placing, result, plots, given["--reach-map"])
        if reach and not forced:
            unreached = placing.hindered(reach)
    if unreached and not forced:
        return result, unreached
    if reach and scenario.safety.proof != "none":
        result, scenario = prove_with_a_pad_that_fits(scenario, result, observer)
    plots["path.png"] = plot_plan(result, "Once around the rim" if dual and not scenario.plan.removal else "")
    observer.stage("time the motion")
    strokes = cycle_strokes(scenario, result.path, result.mesh.noise, observer.progress, reach)
    result.figures.update(time_figures(strokes))
    result.figures["plan_time_s"] += time.perf_counter() - begin
    write_plan(folder, result)
    setup = ExportSetup(scenario.process, scenario.spindle, part_pose=scenario.part.pose)
    export_plan(folder, result, given["--export"] or [], setup)
    observer.stage("draw")
    for surface in (result.surface, result.region.surface):
        surface.free_tree()
    page = path_page(result, setup)
    bad = (f"bad: {text}." for text in faults_of_plan(result.figures))
    page = page._replace(notes=[*page.notes, *bad])
    if reach and strokes:
        page = plan_page(page, scenario, result, reach, strokes)
    save_page(folder, page)
    save_plots(folder, plots)
    return result, unreached


def _show_plan(result: PlanResult, unreached: str, dual: bool) -> None:
    from polish_sim.analysis.metrics import faults_of_plan
    from polish_sim.planning.quality.figures import path_table

    console.notes(result.notes)
    if unreached:
        console.note(f"error: {unreached} The plan is written, unproven.")
    if dual:
        from polish_sim.dual.scene import seat_note

        console.note(seat_note(result.figures))
    for text in faults_of_plan(result.figures):
        console.note(f"bad: {text}.")
    console.table(path_table(f"plan of {result.mesh.name}", result.figures))


def plan_setups(search: SetupSearch, folder: Path, given: Given, observer: Observer) -> Callable[[], None]:
    """Split all of a part into setups and plan each into a folder of its own, ``setup_1`` and so on, beside a
    table.

    Returns what shows the table.

    Raises:
        PlanError: No setup reaches anything of the part.
    """
    from polish_sim.analysis.metrics import faults_of_plan
    from polish_sim.planning.moves.stroke import NO_WAY
    from polish_sim.planning.quality.areas import FAR

    done: list[PlanResult] = []
    for tried, setup in enumerate(iter(search.next, None), 1):
        name = f"setup_{len(done) + 1}"
        observer.stage(
            f"try {tried}, {name}: {setup.scenario.part.up} up, "
            f"{len(setup.patches)} of {search.count} patches"
        )
        try:
            single = len(setup.patches) == 1
            result, unreached = plan_once(setup.scenario, folder / name, given, observer, forced=single)
        except (PlanError, ReachError) as error:
            search.refuse(setup, str(error), elsewhere=isinstance(error, ReachError))
            continue
        lost = next((note for note in result.notes if NO_WAY in note), "") if not single else ""
        if unreached or lost:
            shutil.rmtree(folder / name, ignore_errors=True)
            search.refuse(setup, unreached or lost, elsewhere=bool(unreached))
        else:
            done.append(result)
    missed = [(patch, "the arm does it in no pose that was tried") for patch in search.left] + search.given_up
    if not done:
        raise PlanError(f"no setup reaches anything of the part: {missed[0][1]}")
    rows = [
        {
            "folder": f"setup_{number}",
            "up": result.mesh.up.tolist(),
            "region": result.plan.region,
            **result.figures,
        }
        for number, result in enumerate(done, 1)
    ]
    named = [{"area_m2": patch.area, "at_m": patch.middle.tolist(), "reason": why} for patch, why in missed]
    area = {"part_area_m2": search.part_area, "unreached_area_m2": sum(patch.area for patch, _ in missed)}
    write_json(folder / "metrics.json", {"setups": rows, **area, "unreached": named})
    notes = [*search.notes, *(f"{row['folder']}: {note}" for row, plan in zip(rows, done, strict=True)
             for note in plan.notes if any(word in note for word in ("left out", "--check", FAR))),
             *(f"{row['folder']}: bad: {text}." for row in rows for text in faults_of_plan(row)),
             *_missed_notes(missed)]  # fmt: skip
    return partial(_show_setups, done, area, notes)


def _missed_notes(missed: Sequence[tuple[Patch, str]]) -> list[str]:
    """What no setup reaches, patches of like reasons together."""
    kinds: dict[str, list[tuple[Patch, str]]] = {}
    for patch, why in missed:
        kinds.setdefault(why.partition(":")[0], []).append((patch, why))
    return [
        f"no setup reaches {1e4 * sum(patch.area for patch, _ in alike):.3g} cm^2 in {len(alike)} patches, "
        f"the largest at {place_in_mm(alike[0][0].middle)}: {alike[0][1]}"
        for alike in kinds.values()
    ]


def _show_setups(done: Sequence[PlanResult], area: Mapping[str, float], notes: Sequence[str]) -> None:
    from polish_sim.geometry.orientation import name_direction

    console.notes(notes)
    rows = [
        [
            f"setup_{number}",
            name_direction(result.mesh.up),
            f"{1e4 * result.figures['region_area_m2']:.1f}",
            f"{1e4 * result.figures['left_out_area_m2']:.1f}",
            f"{100.0 * result.figures['coverage']:.1f}",
            str(result.figures["retracts"]),
            f"{result.figures['path_length_m']:.2f}",
            number_or_dash(result.figures["cycle_time_s"], ".1f"),
        ]
        for number, result in enumerate(done, 1)
    ]
    headings = [
        "setup",
        "up",
        "region, cm^2",
        "left out",
        "covered, %",
        "strokes",
        "path, m",
        "cycle time, s",
    ]
    console.table(Table(f"setups of {done[0].mesh.name}", headings, rows, left=2))
    console.say(
        f"of the part's {1e4 * area['part_area_m2']:.1f} cm^2 no setup reaches "
        f"{1e4 * area['unreached_area_m2']:.1f} cm^2"
    )


def find_place(
    placing: PartPlacing, result: PlanResult, plots: dict[str, Figure], reach_map: bool | None
) -> tuple[Reach | None, str]:
    """Find where the part stands and add it to a plan's figures, and the reach map to its pictures if asked
    for.

    Returns how the robot does the path, and why it cannot: None and the reason, or the reach and nothing.
    """
    reach = None
    why = ""
    try:
        reach = placing.reach()
        result.figures["T_base_work"] = reach.T_base_work.tolist()
    except ReachError as error:
        why = str(error)
    result.figures["smallest_singular_value"] = reach.smallest_singular_value if reach else math.nan
    if reach_map:
        from polish_sim.experiments.reach_plot import plot_reach_map

        T_base_work = reach and reach.T_base_work
        plots["reach_map.png"] = plot_reach_map(placing.map(), result.mesh, T_base_work)
    return reach, why


def plan_for_two(scenario: Checked, observer: Observer) -> PlanResult:
    """Plan once around a part's rim for two robots, or an even removal, and check that both arms can do it.

    The plan's figures say where the part is held and how both arms start.

    Raises:
        PolishSimError: If the part cannot be used or planned, or an arm cannot follow.
    """
    from polish_sim.dual.task import prepare_dual
    from polish_sim.experiments.even_removal import planned
    from polish_sim.planning import measure_given_path

    begin = time.perf_counter()
    scenario, plan = planned(scenario, None, observer)
    task = prepare_dual(scenario, plan, observer)
    planned_s = time.perf_counter() - begin
    result = plan or measure_given_path(task.place.path, *scenario.planned_by, observer)
    result.figures.setdefault("axis_deviation_max_rad", 0.0)
    result.figures.update(
        plan_time_s=planned_s,
        placement_value=task.reach.value,
        chain_residual_m=task.residual,
        T_gripper_work=task.seat.T_gripper_work.tolist(),
        T_master_work=task.reach.T_master_work.tolist(),
        T_follower_work=task.place.reach.T_base_work.tolist(),
        q_master_rad=task.reach.q_master.tolist(),
        q_follower_rad=task.reach.q_follower.tolist(),
        tool_spin_rad=task.reach.spin,
    )
    return result
