"""Plan, simulate and measure a job's passes one after the other; what is done is on disk (Job -> folder).

A pass under way writes a piece of its record every simulated second. After a stop or a kill it resumes behind
the last whole piece: the tool lands there, and its force rises over a pad's diameter.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.analysis.claim import bound_text, figure_of, shortfalls, value_text
from polish_sim.analysis.metrics import faults_of_force, faults_of_plan, measure_removal
from polish_sim.analysis.run_record import REMOVAL, RunRecord, read_record, write_record
from polish_sim.arrays import norms
from polish_sim.cell import Cell, Observer
from polish_sim.cell.cell import Played
from polish_sim.cell.stroke import cycle_time
from polish_sim.config import Checked, ProcessConfig
from polish_sim.errors import InputError, PolishSimError, named_place
from polish_sim.exchange import ExportSetup, export_plan, plan_facts, read_cuts, read_path, write_plan
from polish_sim.experiments.assembly import build_cell
from polish_sim.experiments.even_removal import plan_removal
from polish_sim.experiments.proof import prove_with_a_pad_that_fits
from polish_sim.experiments.registry import claims_shown, experiment
from polish_sim.experiments.result import RunResult
from polish_sim.experiments.surface import areas_after, measure_run, prepare_surface
from polish_sim.geometry import PartMesh, Surface, fit_surface, select_region
from polish_sim.job.job_file import Job, Pass
from polish_sim.job.tools import naming_line
from polish_sim.log import PROCESS_PHASE, UNREADABLE, RemovalMap, read_removal, write_arrays
from polish_sim.planning import PlanResult, measure_given_path
from polish_sim.planning.part_plan import choose_region, load_mesh
from polish_sim.planning.toolpath import stretches
from polish_sim.row_file import METRICS, Metrics, check_sum, read_json, whole_folder, write_json
from polish_sim.scenario_file import merge
from polish_sim.spatial import to_pose

PIECE_S = 1.0  #: Of simulated time between pieces on disk
NOTHING_M = 1e-4  #: So little of a path left is done [m]
ON_ZONE_M = 1e-4  #: Points of a path so near a zone are in it [m]


class PassRow(NamedTuple):
    """One pass that is done: what job.json says of it."""

    folder: str
    part: int
    work: Pass
    figures: Metrics


def check_regions(job: Job) -> None:
    """Find the region and the zones of every pass on the part, before anything is planned or written.

    Raises:
        PolishSimError: The part cannot be used, or has no such region; says the line.
    """
    parts: dict[Any, tuple[PartMesh, Surface]] = {}
    for one in job.passes:
        asked = one.scenario.plan
        key = (one.scenario.part, asked.feature_angle_rad)
        with naming_line(job.file), named_place(f"{one.folder}, '{asked.region}'"):
            if key not in parts:
                mesh = load_mesh(one.scenario.part)
                parts[key] = mesh, fit_surface(mesh, asked.feature_angle_rad)
            mesh, surface = parts[key]
            choose_region(mesh, surface, asked)
        for zone in one.zones:
            with naming_line(job.file), named_place(f"{one.folder}, zone '{zone.region}'"):
                select_region(surface, mesh, zone.region, asked.feature_angle_rad)


def run_job(job: Job, folder: Path, observer: Observer) -> Iterator[PassRow]:
    """Do what is not done yet; each pass is given when it is on disk.

    Raises:
        PolishSimError: A pass cannot be planned or run; says which.
    """
    worn: dict[tuple[str, int], float] = {}
    for part in range(1, job.head.parts + 1):
        for one in job.passes:
            here = f"part_{part}/{one.folder}" if job.head.parts > 1 else one.folder
            target = folder / here
            observer.stage(here)
            if not (target / "run").is_dir():
                seeded = one._replace(scenario=replace(one.scenario, seed=job.head.seed + part - 1))
                with naming_line(job.file), named_place(here):
                    run_pass(seeded, target, worn.get(one.abrasive, 0.0), observer)
            try:
                figures = {**plan_facts(target / "plan"), **read_record(target / "run").metrics}
                read_removal(target / "run" / REMOVAL)
            except PolishSimError as error:
                raise _no_longer_whole(target, error) from None
            for key in ("sliding_work_after_nm", *PASS_KEYS):
                if key not in figures:
                    raise _no_longer_whole(target, f"{key} is not in run/{METRICS}.")
            worn[one.abrasive] = figures["sliding_work_after_nm"]
            figures["notes"] += experiment(one.scenario.experiment).notes_of(figures, one.scenario)
            figures["bad_figures"] += [
                f"{claim.label} {value_text(claim, figure_of(figures, claim.figure))} {claim.unit}, "
                f"run --check asks {bound_text(claim)}"
                for claim in shortfalls(claims_shown([one.scenario]), figures)
                if claim.figure != "force_within_4n"  # there already
            ]
            yield PassRow(here, part, one, figures)


def run_pass(one: Pass, folder: Path, worn: float, observer: Observer) -> None:
    """Plan a pass unless its plan is there, run what of it is not done, and write its figures.

    ``worn`` is the sliding work its abrasive has done [N m]: it takes off less, and the feed is lower for it.
    """
    left = one.tool.left(worn)
    process = replace(one.scenario.process, feed_m_s=max(one.scenario.process.feed_m_s * left, 1e-4))
    plan, scenario = _planned(one, replace(one.scenario, process=process), folder, observer)
    whole = plan
    parts: list[RunResult] = []
    planned_s = math.nan
    while True:
        place = prepare_surface(scenario, plan)
        cell = build_cell(scenario, place)
        planned_s = planned_s if parts else cycle_time(cell.strokes)
        # Named by the path left to do: where fewer pieces before count than when it began, it begins anew.
        pieces = folder / "pieces" / f"{len(parts)}-{plan.path.length_m:.6f}"
        before = _read_pieces(pieces)
        reached = max(
            (piece.trace["path_s_m"][-1] for piece in before if piece.trace["phase"][-1] >= PROCESS_PHASE),
            default=None,
        )
        played = before if reached is not None else _play(cell, pieces, observer)
        parts.append(measure_run(plan, place, cell, cell.result(played)))
        starts, ends = plan.path.s[np.transpose(stretches(plan.path.process))]
        if reached is None or reached >= ends[-1] - NOTHING_M:
            break
        # Of a stroke more than a step-over: a shorter one would be left out.
        stroke = np.searchsorted(ends, reached)
        plan = plan.behind(min(reached, max(starts[stroke], ends[stroke] - 1.5 * plan.plan.stepover_m)))
    _write(one, folder, whole, parts, worn, left, planned_s)


def _planned(one: Pass, scenario: Checked, folder: Path, observer: Observer) -> tuple[PlanResult, Checked]:
    """The plan on disk, or a new one; and the scenario with the part where it was proven."""
    done = folder / "plan"
    if done.is_dir():
        try:
            part = merge(scenario.part, {"pose": read_json(done / "pass.json")["pose"]}, "part.")
        except (PolishSimError, KeyError):
            raise _no_longer_whole(folder, "plan/pass.json is gone or damaged.") from None
        scenario = replace(scenario, part=part)
        cuts = read_cuts(done)
        return measure_given_path(read_path(done), *scenario.planned_by, cuts=cuts), scenario
    plan = zoned(one, scenario.process, plan_removal(scenario, observer))
    if scenario.safety.proof != "none":
        plan, scenario = prove_with_a_pad_that_fits(scenario, plan, observer)
    pose = to_pose(prepare_surface(scenario, plan).reach.T_base_work)
    scenario = replace(scenario, part=replace(scenario.part, pose=pose))
    # A job is repeated byte for byte.
    plan = replace(plan, figures={**plan.figures, "plan_time_s": 0.0})
    folder.mkdir(parents=True, exist_ok=True)
    with whole_folder(done) as draft:
        setup = ExportSetup(scenario.process, scenario.spindle, part_pose=pose)
        made = export_plan(draft, plan, () if one.tool.flange.bandwidth_hz else ("urscript",), setup)
        write_json(
            draft / "pass.json",
            {"pose": list(pose), "programme": [check_sum(file.read_text()) for file in made]},
        )
        write_plan(draft, plan)
    return plan, scenario


def zoned(one: Pass, process: ProcessConfig, plan: PlanResult) -> PlanResult:
    """The plan with less force near the region's border, and the zones' own force and feed."""
    if one.head.edge_force == 1.0 and not one.zones:
        return plan
    path = plan.path
    force = path.force_at(path.s, process.contact_force_n)
    feed = path.feeds(process.feed_m_s)
    away, _ = cKDTree(np.concatenate(plan.region.boundary_loops)).query(path.positions_work)
    force *= np.interp(away, [0.0, one.head.edge_m], [one.head.edge_force, 1.0])
    for zone in one.zones:
        region = select_region(plan.surface, plan.mesh, zone.region, plan.plan.feature_angle_rad)
        off = norms(region.surface.closest(path.positions_work).positions - path.positions_work)
        force = np.where(off < ON_ZONE_M, force * zone.force, force)
        feed = np.where(off < ON_ZONE_M, feed * zone.feed, feed)
    return replace(plan, path=replace(path, force=force, feed=feed))


def _play(cell: Cell, folder: Path, observer: Observer) -> list[Played]:
    """Run a cell to its end, a piece on disk every second."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    dt = cell.kernel.engine.dt
    total = cycle_time(cell.strokes)
    played = list[Played]()
    while not cell.done:
        played.append(cell.play(round(PIECE_S / dt)))
        write_arrays(folder / f"{len(played):06}.npz", played[-1]._asdict())
        observer.progress(min(cell.state.status.steps * dt, total), total)
    return played


def _read_pieces(folder: Path) -> list[Played]:
    """The pieces up to the first that is not there or damaged."""
    found = list[Played]()
    with suppress(*UNREADABLE):
        while True:
            with np.load(folder / f"{len(found) + 1:06}.npz", allow_pickle=False) as piece:
                found.append(Played(piece["rows"], piece["trace"]))
    return found


def summed_maps(maps: list[RemovalMap], left: float = 1.0) -> RemovalMap:
    """What several runs took off together, on the nodes of the first, times what is ``left`` of the
    abrasive."""
    first = maps[0]
    taken = [left * each.exposure[cKDTree(each.vertices).query(first.vertices)[1]] for each in maps]
    return replace(first, exposure=np.sum(taken, axis=0))


def _write(
    one: Pass,
    folder: Path,
    plan: PlanResult,
    parts: list[RunResult],
    worn: float,
    left: float,
    planned_s: float,
) -> None:
    last = parts[-1]
    maps = [result.removal for result in parts if result.removal]
    scenario = last.scenario
    removal = summed_maps(maps, left)
    simulated = sum(result.figures["simulated_s"] for result in parts)
    fed = sum(result.trace.fed.sum() for result in parts) * scenario.simulation.timestep_s
    # pressure x sliding way summed over the part, beside the region too [N m]
    work = sum(float(each.areas @ each.exposure) + each.elsewhere_nm for each in maps)
    figures = {
        **last.figures,
        **areas_after(plan, removal),
        "tracking_error_max_m": max(result.figures["tracking_error_max_m"] for result in parts),
        **measure_removal(removal, scenario.pad.radius_m),
        "cycle_time_s": simulated,
        "planned_cycle_time_s": planned_s,
        "contact_time_s": fed,
        "air_time_s": simulated - fed,
        "pieces": len(parts),
        "abrasive_path_m": work / scenario.process.contact_force_n,
        "sliding_work_after_nm": worn + work,
        "abrasive_left": left,
        "grit": one.head.grit,
        "tool": one.head.tool,
        "wall_s": 0.0,
        "real_time_factor": 0.0,
    }
    most = plan.path.largest_force(scenario.process.contact_force_n)
    faults = (text for result in parts for text in faults_of_force(result.figures, most))
    figures["bad_figures"] = [*dict.fromkeys(faults), *faults_of_plan(figures)]
    with whole_folder(folder / "run") as draft:
        write_record(draft, RunRecord(scenario.experiment, scenario, figures, last.log, last.path, removal))
    shutil.rmtree(folder / "pieces")


def job_figures(job: Job, folder: Path, rows: list[PassRow]) -> dict[str, Any]:
    """What job.json says: passes, times, and the removal of each region summed over its passes."""
    regions: dict[str, list[PassRow]] = {}
    operator = 0.0
    clamped = mounted = None
    for row in rows:
        one = row.work
        regions.setdefault(row.folder.rpartition("/")[0], []).append(row)
        if clamped != (row.part, one.setup):
            operator += one.setup_head.clamp_s
        if mounted != one.abrasive:
            operator += one.head.change_s
        clamped, mounted = (row.part, one.setup), one.abrasive
    sums = [
        {
            "region": name,
            **measure_removal(
                summed_maps([read_removal(folder / row.folder / "run" / REMOVAL) for row in those]),
                those[0].work.tool.radius_m,
            ),
        }
        for name, those in regions.items()
    ]
    total = {name: sum(row.figures[name] for row in rows) for name in SUMMED}
    area = sum(max(row.figures["polished_area_m2"] for row in those) for those in regions.values())
    whole = total["cycle_time_s"] + operator
    # What is left of a path that was stopped would take longer than its share.
    stopped = any(row.figures["protective_stop"] for row in rows)
    return {
        "job_sha256": job.sha256,
        "parts": job.head.parts,
        **total,
        "operator_s": operator,
        "whole_s": whole,
        "polished_area_m2": area,
        "polished_per_hour_m2": math.nan if stopped else 3600.0 * area / whole,
        "passes": [{"folder": row.folder, **{k: row.figures[k] for k in PASS_KEYS}} for row in rows],
        "regions": sums,
    }


SUMMED = ("cycle_time_s", "planned_cycle_time_s", "contact_time_s", "air_time_s", "abrasive_path_m")
"""Figures of a pass that are summed over a job."""
PASS_KEYS = (
    "tool",
    "grit",
    "region_area_m2",
    "polished_area_m2",
    "left_out_area_m2",
    "left_out",
    "fit_unsure_m",
    *SUMMED,
    "pieces",
    "path_done",
    "abrasive_left",
    "removal_cv",
    "removal_cv_inside",
    "force_rms_error_n",
    "protective_stop",
    "bad_figures",
    "notes",
)


def programs(job: Job, folder: Path) -> Iterator[tuple[int, str]]:
    """A programme for each setup: its passes one after the other, a message wherever the operator acts."""
    for number in sorted({one.setup for one in job.passes}):
        those = [one for one in job.passes if one.setup == number]
        lines = []
        mounted = None
        clamped = those[0].setup_head
        calls = [_say(f"Clamp the part: {clamped.name or clamped.up}.")]
        for k, one in enumerate(those, 1):
            if mounted != one.abrasive:
                grit = f", grit {one.head.grit}" if one.head.grit else ""
                calls.append(_say(f"Mount {one.head.tool}{grit}."))
            mounted = one.abrasive
            if one.tool.flange.bandwidth_hz:
                calls.append(_say(f"Run {one.folder}/plan with the flange's own programme: no force mode."))
                continue
            text = _programme(folder / ("part_1" if job.head.parts > 1 else "") / one.folder)
            name = next(line.split()[1] for line in text.splitlines() if line.startswith("def "))
            lines += [text.replace(name, f"{name}_{k}")]
            calls.append(f"  {name}_{k}()")
        yield number, "\n".join([*lines, f"def setup_{number}():", *calls, "end", f"setup_{number}()", ""])


def _programme(folder: Path) -> str:
    """The robot's programme of a pass."""
    plan = folder / "plan"
    with suppress(OSError, ValueError, InputError):
        text = (plan / "path.script").read_text(encoding="utf-8")
        made = [check_sum(text)]
        if read_json(plan / "pass.json").get("programme", made) == made:
            return text
    raise _no_longer_whole(folder, "plan/path.script or pass.json is gone or damaged.")


def _no_longer_whole(folder: Path, what: object) -> InputError:
    return InputError(f"delete '{folder}', and --resume does that pass again, it is no longer whole: {what}")


def _say(text: str) -> str:
    return f'  popup("{text}", title="polish-sim", blocking=True)'
