"""Jobs that nothing was tuned on: each is planned, run on three more arms, and looked at by other commands.

    python -m benchmarks.drawn_jobs [--first 20600] [--count 10] [--parts FOLDER] [--out FOLDER]

A seed draws part, settings and region (`random_jobs`). `plan` plays the job with two draws of arm and part;
three runs along the plan draw others and are asked to ``--check``. `inspect` measures every plan; `smooth`, a
run from further on, one that learned, exported paths and a whole job follow by chance. Each command is a
process of its own with a limit of processor time.

Prints a line for each job and for each fault, then a table of sums, after Ctrl-C of the jobs that are
done. A fault is a traceback, an exit code outside of the contract, a figure that is no number, areas that
contradict each other, figures of `inspect` that are not the plan's, a protective stop, lost contact, and
a run that falls short where its plan did not say so. Of both limits of `run --check`, force and
tangential error, the table says how many times as much a run used as the proof of its plan has noted: a
plan says that it may fail from 1/1.4 of a limit on.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.commands import Call, call
from benchmarks.random_bodies import usable_files
from benchmarks.random_jobs import draw_job
from benchmarks.table import Row, print_rows
from polish_sim.analysis.metrics import force_shares
from polish_sim.config import Scenario
from polish_sim.exchange import plan_facts, read_path
from polish_sim.experiments.proof_play import ASTRAY, BAND, SETTLED_M
from polish_sim.experiments.rows import most_astray
from polish_sim.log import read_log
from polish_sim.planning.toolpath import stretches
from polish_sim.scenario_file import load_scenario

RUNS = 3
KEPT = ("coverage", "coverage_stepover", "path_length_m", "stepover_p5_m", "self_crossings", "region_area_m2")
"""Figures that `inspect` measures as `plan` does, within `APART`."""
APART = 2e-3
FIGURES = (
    ("largest force error of a run [N]", "force_max_deviation_n", 1.0),
    ("tangential error of a run [mm]", "tracking_error_max_m", 1e3),
    ("contact lost in a run [s]", "contact_lost_s", 1.0),
)
ANNOUNCES = r"--check|may stop"  #: In a plan's notes: runs may fall short


class Outcome(NamedTuple):
    """What became of a job."""

    seed: int
    plan: Call
    runs: list[Call]
    faults: list[str]
    ratios: list[dict[str, float]]  #: Of each run, see `ratios_to_proof`


def ratios_to_proof(run: Call, plan: Path) -> dict[str, float]:
    """How much of each limit of `run --check` a run used, over what the proof of its plan has noted.

    The proof notes 1.4 times what no step may be (a blow, contact lost); of the run it counts once.
    """
    facts, path, log = plan_facts(plan), read_path(plan), read_log(run.folder / "log.npz")
    usual, arm = facts["contact_force_n"], load_scenario(run.folder / "config.toml", Scenario()).robot
    s = log["path_s_m"][log.fed]
    starts = path.s[[first for first, _ in stretches(path.process)]]
    held = s - starts[np.maximum(np.searchsorted(starts, s, side="right") - 1, 0)] > SETTLED_M
    wanted, most = path.force_at(s, usual), path.largest_force(usual)
    forces = [log[f"normal_force_{end}_n"][log.fed] for end in ("min", "max")]
    used = {
        BAND: max(np.max(force_shares(force, wanted, most, held)) for force in forces),
        ASTRAY: run.figures["tracking_error_max_m"] / most_astray(arm),
    }
    return {name: float(share / facts["proof"]["limits"][name]["share"]) for name, share in used.items()}


def run_faults(run: Call, plan: Call) -> Iterator[str]:
    """What is wrong with a run along a plan."""
    yield from run.faults((0, 1, 3))
    of, figures = run.folder.name, run.figures
    if figures.get("protective_stop"):
        yield f"{of}: stopped: {figures['protective_stop']}"
    if figures.get("contact_lost_s"):
        yield f"{of}: contact lost for {figures['contact_lost_s']:.3g} s"
    short = run.said(r"^bad:|\bNO$") if run.code == 1 else []
    if run.code == 1 and not short:
        yield f"{of}: exit 1 without a reason"
    for line in short:
        if not (plan.said("^bad:") if re.search("left out|the fit is", line) else may_fail(plan)):
            yield f"{of}: its plan did not say: {' '.join(line.split())}"


def may_fail(plan: Call) -> bool:
    """Whether a plan says that runs may fall short or stop."""
    return any(re.search(ANNOUNCES, note) for note in plan.figures["notes"])


def inspect_faults(inspected: Call, plan: Call) -> Iterator[str]:
    """What is wrong with `inspect` of a plan."""
    yield from inspected.faults()
    for name in KEPT if inspected.figures else ():
        planned, found = plan.figures[name], inspected.figures[name]
        if found != planned and (
            None in (found, planned) or abs(planned - found) > APART * max(abs(planned), 1e-3)
        ):
            yield f"inspect: {name} {found}, of the plan {planned}"


def other_faults(
    plan: Call, first: Call, along: Sequence[object], seen: Sequence[str], rng: np.random.Generator
) -> Iterator[str]:
    """What is wrong with other commands on a plan; ``along`` are the words of its ``first`` run, ``seen``
    those of part and region."""
    folder, part, chance = plan.folder.parent, seen[0], rng.random(4)
    begin = 1e3 * plan.figures["path_length_m"] * rng.uniform(0.05, 0.95)
    yield from inspect_faults(call(folder / "inspect", "inspect", plan.folder), plan)
    if (apt := plan.folder / "path.apt").exists():
        yield from call(folder / "inspect_apt", "inspect", apt, "--part", *seen).faults()
    if chance[0] < 0.3:
        yield from call(folder / "smooth", "smooth", plan.folder).faults()
    if chance[1] < 0.4:
        yield from run_faults(call(folder / "from", *along, "--from", f"{begin:.1f}"), plan)
    if chance[2] < 0.35 and first.code in (0, 1) and "hybrid-adaptive" not in along:
        yield from run_faults(call(folder / "learn", *along, "--learn", first.folder), plan)
    if chance[3] < 0.1:
        yield from call(folder / "job.toml", "job", "init", part).faults()
        yield from call(folder / "job", "job", folder / "job.toml").faults((0, 1, 2))


def try_job(seed: int, files: Sequence[Path], out: Path) -> Outcome:
    """Plan and run a drawn job, try other commands on it, and print its line."""
    folder = out / str(seed)
    folder.mkdir(parents=True, exist_ok=True)
    job, part, rng = draw_job(seed, files, folder), folder / "part.stl", np.random.default_rng([seed, 22])
    job.mesh.export(part)
    export = ("--export", "all") if rng.random() < 0.3 else ()
    plan = call(folder / "plan", "plan", part, *job.region, *job.planned, *job.cell, *export, "--seed", seed)
    outcome = Outcome(seed, plan, [], [*plan.faults((0, 2, 3))], [])
    if plan.code == 0:
        along = ["run", "surface", "--path", plan.folder, *job.cell, "--check"]
        for number in range(10 * seed, 10 * seed + RUNS):
            run = call(folder / f"run_{number}", *along, "--seed", number)
            outcome.runs.append(run)
            outcome.faults.extend(run_faults(run, plan))
            outcome.faults.extend(run.said("proven again"))
            if run.code in (0, 1):
                outcome.ratios.append(ratios_to_proof(run, plan.folder))
        along += ["--seed", 10 * seed]
        outcome.faults.extend(other_faults(plan, outcome.runs[0], along, [part, *job.region], rng))
    print_outcome(outcome, f"{job.name} {' '.join(map(str, (*job.region, *job.planned, *job.cell)))}")
    return outcome


def print_outcome(outcome: Outcome, job: str) -> None:
    """The line of a job, and one for each fault."""
    plan, figures = outcome.plan, outcome.plan.figures
    said = [line[:150] for line in plan.said("^error:")]
    if figures:
        left, region = (1e4 * figures[f"{name}_area_m2"] for name in ("left_out", "region"))
        said += [f"{left:.1f} of {region:.1f} cm^2 left out", *["may fail"] * may_fail(plan)]
    runs = "; ".join(
        f"{run.code}, {run.figures['force_max_deviation_n'] or math.nan:.1f} N, "
        f"{1e3 * (run.figures['tracking_error_max_m'] or math.nan):.2f} mm"
        for run in outcome.runs
        if run.figures
    )
    print(
        f"{outcome.seed} {job}: plan {plan.code}, {plan.cpu_s:.0f} s, {', '.join(said)}; runs {runs or '-'}"
    )
    print(*(f"    FAULT {fault}\n" for fault in outcome.faults), sep="", end="", flush=True)


def sums(outcomes: Sequence[Outcome]) -> Iterator[Row]:
    """The rows of the table: a figure, and its worst with the seed where that is."""
    done = [outcome for outcome in outcomes if outcome.runs]
    codes = Counter(outcome.plan.code for outcome in outcomes)
    yield Row("jobs: planned, refused, out of the arm's reach", f"{codes[0]}, {codes[2]}, {codes[3]}", "")
    yield _spread("processor time of a plan [s]", [(o.plan.cpu_s, o.seed) for o in outcomes])
    left = [(o.plan.figures["left_out_area_m2"] / o.plan.figures["region_area_m2"], o.seed) for o in done]
    yield _spread("share of the region left out", left)
    runs = [(run, may_fail(o.plan), o.seed) for o in done for run in o.runs]
    codes = Counter(run.code for run, _, _ in runs)
    yield Row("runs: fine, short, stopped", f"{codes[0]}, {codes[1]}, {codes[3]}", "")
    said = [run.code for run, may, _ in runs if may]
    yield Row("runs whose plan says they may fail; fine of them", f"{len(said)}, {said.count(0)}", "")
    for text, name, scale in FIGURES:
        yield _spread(text, [(scale * run.figures[name], seed) for run, _, seed in runs if run.figures])
    for name in (BAND, ASTRAY):
        yield _spread(f"{name}, over that of the proof", [(r[name], o.seed) for o in done for r in o.ratios])
    yield Row("faults", str(sum(len(outcome.faults) for outcome in outcomes)), "")


def _spread(name: str, found: Sequence[tuple[float, int]]) -> Row:
    if not found:
        return Row(name, "-", "-")
    worst, seed = max(found)
    return Row(name, f"{np.median([value for value, _ in found]):.3g}", f"{worst:.2g} ({seed})")


def main() -> None:
    """Try the jobs and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=20600)
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--parts", type=Path, help="folder of STL files; half of the jobs take one of them")
    parser.add_argument("--out", type=Path, help="where all is kept; else it is removed")
    asked = parser.parse_args()
    if asked.parts and not asked.parts.is_dir():
        parser.error(f"--parts '{asked.parts}' is no folder.")
    files = usable_files(asked.parts) if asked.parts else []
    outcomes = list[Outcome]()
    with tempfile.TemporaryDirectory() as scratch, suppress(KeyboardInterrupt):
        for seed in range(asked.first, asked.first + asked.count):
            outcomes.append(try_job(seed, files, asked.out or Path(scratch)))
    title = f"{len(outcomes)} of {asked.count} drawn jobs"
    print_rows(title, sums(outcomes), ("median", "worst (seed)"))
    sys.exit(len(outcomes) < asked.count or any(outcome.faults for outcome in outcomes))


if __name__ == "__main__":
    main()
