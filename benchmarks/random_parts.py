"""Plan random parts and say what went wrong:
`python -m benchmarks.random_parts --count 200 --pattern spiral`."""

from __future__ import annotations

import argparse
import re
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.random_draw import RandomPart, draw_part
from polish_sim.config import ProcessConfig
from polish_sim.errors import PolishSimError
from polish_sim.geometry import PartMesh, load_part
from polish_sim.planning import PlanResult, plan_mesh
from polish_sim.planning.ground import prepare_ground
from polish_sim.planning.quality.coverage import STRICT, strictly_covered
from polish_sim.planning.quality.located import ground_under, locate
from polish_sim.planning.quality.tool_room import pressed_places
from polish_sim.workers import open_workers

Array = NDArray[np.float64]

COVERAGE = 0.98
INSIDE = 0.45
"""A turn keeps a number of step-overs inside the border: the tip of a star is out of its reach."""
ON_SURFACE_M = 1e-9
REGION_AREA = 0.02
"""The region's area may differ this much from that of a smooth top, whose flat facets were summed."""


class Outcome(NamedTuple):
    """What became of one part."""

    seed: int
    name: str
    region: str
    facets: int
    faults: tuple[str, ...]
    """What is wrong with the plan; empty if all is well."""
    refusal: str
    """The message, if the part was refused."""
    coverage: float
    reached: float
    """Coverage of what is within 0.55 step-overs of a place where the tool is clear of the part, inside the
    border."""
    runs: int
    seconds: float


def examine(seed: int, pattern: str = "spiral", region: str = "", limit_s: float = 120.0) -> Outcome:
    """Draw a part, plan it and check the plan."""
    part = draw_part(seed, pattern, region)
    begin = time.process_time()
    faults: list[str] = []
    refusal, figures, reached = "", {"coverage_stepover": np.nan, "retracts": 0}, np.nan
    signal.signal(signal.SIGPROF, _too_slow)
    signal.setitimer(signal.ITIMER_PROF, limit_s)
    try:
        result = plan_mesh(mesh_of(part), part.plan, pad=part.pad)
        figures = result.figures
        reached = coverage_of_reachable(result)
        faults = list(find_faults(part, result))
    except PolishSimError as error:
        refusal = str(error)
    except Exception as error:
        place = _where(error)
        faults = [f"crash: {type(error).__name__}: {str(error)[:60]} at {place}"]
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    choice = part.plan.region.partition(":")[0]
    seconds = time.process_time() - begin
    return Outcome(
        seed, part.name, choice, len(part.triangles), tuple(faults), refusal,
        figures["coverage_stepover"], reached, figures["retracts"], seconds,
    )  # fmt: skip


def mesh_of(part: RandomPart) -> PartMesh:
    """The part as it reaches planning: by way of an STL file, or its exact vertices."""
    if part.as_file:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "part.stl"
            write_stl(file, 1e3 * part.triangles)
            return replace(load_part(file, "mm", "z"), up=part.up)
    return exact_mesh(part.solid.vertices, part.solid.faces, part.up)


def exact_mesh(vertices: Array, faces: NDArray[Any], up: Array) -> PartMesh:
    """A mesh that comes from no file, vertices (n, 3) [m] and faces (m, 3)."""
    numbers = np.arange(len(faces), dtype=np.int32)
    last = numbers[-1]
    return PartMesh(vertices, faces.astype(np.int32), up, "exact", Path("exact"), "", "m", numbers, last, ())


def write_stl(file: Path, triangles: Array) -> None:
    """Write a binary STL, triangles (m, 3, 3), normals left zero."""
    record = np.zeros(
        len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]
    )
    record["corners"] = triangles
    file.write_bytes(b"random part".ljust(80) + np.uint32(len(triangles)).tobytes() + record.tobytes())


def coverage_of_reachable(result: PlanResult) -> float:
    """Share covered within 0.55 step-overs of what the tool can get that near to, by the area of vertices."""
    if not result.figures["coverage_stepover"] < COVERAGE:
        return float(result.figures["coverage_stepover"])
    ground, step = prepare_ground(result.region, result.plan), result.plan.stepover_m
    mesh, surface = ground.mesh, ground.region.surface
    points, runs = mesh.vertices, locate(ground, result.path, ProcessConfig()).runs
    foot = surface.closest(points)
    under = ground_under(surface, foot)
    places = pressed_places(points, under.normals, under, result.tool.pad, result.tool.force)
    clear = result.tool.stands_in(result.surface, places).depths == 0.0
    clear &= cKDTree(points[np.unique(mesh.border)]).query(points)[0] >= INSIDE * step
    near = cKDTree(points[clear]).query(points)[0] <= STRICT * step
    areas = ground.part_areas
    return float(areas[near & strictly_covered(points, mesh.normals, runs, step)].sum() / areas[near].sum())


def find_faults(part: RandomPart, result: PlanResult) -> Iterator[str]:
    """Everything that must hold for every plan and does not."""
    path, figures = result.path, result.figures
    if figures["self_crossings"]:
        yield f"{figures['self_crossings']} crossings"
    if not (reached := coverage_of_reachable(result)) >= COVERAGE:
        yield f"coverage {reached:.3f}"
    if not figures["max_distance_to_surface_m"] <= ON_SURFACE_M:
        yield f"{figures['max_distance_to_surface_m']:.1e} m off the surface"
    finite = all(np.isfinite(column).all() for column in vars(path).values() if column is not None)
    if not finite or np.abs(np.linalg.norm(path.axes_work, axis=1) - 1.0).max() > 1e-9:
        yield "axes not unit"
    if (np.diff(path.pass_index) < 0).any() or (np.diff(path.s) <= 0.0).any():
        yield "order of passes"
    depth = lead_depth(part, result)
    if depth > 0.0:
        yield f"lead {1e3 * depth:.2f} mm inside"
    truth = float(triangle_areas(part.solid.vertices[part.solid.faces[: part.solid.top]]).sum())
    if (
        part.smooth
        and part.plan.region == "auto"
        and abs(figures["region_area_m2"] / truth - 1.0) > REGION_AREA
    ):
        yield f"region {figures['region_area_m2'] / truth:.2f} of the top"


def triangle_areas(corners: Array) -> Array:
    """Areas of triangles (m, 3, 3), shape (m,)."""
    return 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )


def lead_depth(part: RandomPart, result: PlanResult) -> float:
    """How deep the tool point is inside the part on its way to and from contact [m]."""
    free = result.path.positions_work[~result.path.process][::3]
    corners = part.solid.vertices[part.solid.faces]
    size = float(np.ptp(part.solid.vertices, axis=0).max())
    away = np.linalg.norm(result.surface.closest(free).positions - free, axis=1)
    # The smooth surface stands a little off the flat facets.
    within = (away > 1e-3 * size) & (winding(free, corners) > 0.5)
    return float(away[within].max(initial=0.0))


def winding(points: Array, corners: Array) -> Array:
    """How often a closed mesh (m, 3, 3) winds around points (n, 3): 1 inside, 0 outside."""
    total = np.empty(len(points))
    for number, point in enumerate(points):
        a, b, c = (corners[:, k] - point for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=1)
        under = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        total[number] = np.arctan2(volume, under).sum() / (2.0 * np.pi)
    return total


def _too_slow(*_: object) -> None:
    raise TimeoutError("too slow")


def _where(error: Exception) -> str:
    last = error.__traceback__
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    return f"{Path(last.tb_frame.f_code.co_filename).name}:{last.tb_lineno}" if last else "?"


def print_outcome(outcome: Outcome) -> None:
    """One line of the table."""
    state = "; ".join(outcome.faults) or (f"refused: {outcome.refusal[:90]}" if outcome.refusal else "ok")
    print(
        f"{outcome.seed:5d} {outcome.facets:6d} {outcome.seconds:6.1f} s {outcome.coverage:7.4f} "
        f"{outcome.reached:7.4f} {outcome.runs:3d} "
        f"{outcome.region:8s} {outcome.name[:70]:70s} {state}",
        flush=True,
    )


def print_summary(outcomes: Sequence[Outcome]) -> None:
    """Shares, reasons, worst figures."""
    planned = [o for o in outcomes if not o.refusal and not o.faults]
    refused = Counter(re.sub(r"[-\d.,;:]+", "#", o.refusal)[:70] for o in outcomes if o.refusal)
    faulty = Counter(
        fault.split(" ")[0 if "crossings" not in fault else 1] for o in outcomes for fault in o.faults
    )
    coverage = [o.coverage for o in outcomes if np.isfinite(o.coverage)]
    reached = np.array([o.reached for o in outcomes if np.isfinite(o.reached)])
    seconds = [o.seconds for o in outcomes]
    print(f"\n{len(planned)} of {len(outcomes)} planned without a fault, {sum(refused.values())} refused")
    for reason, count in refused.most_common():
        print(f"  refused {count:3d}: {reason}")
    for fault, count in faulty.most_common():
        print(f"  fault   {count:3d}: {fault}")
    print(f"coverage_stepover: worst {min(coverage, default=np.nan):.4f}, median {np.median(coverage):.4f}")
    print(
        f"of what the tool can reach: >= {COVERAGE:g} on {100.0 * np.mean(reached >= COVERAGE):.1f}% of the "
        "parts"
    )
    print(f"time: median {np.median(seconds):.1f} s, longest {max(seconds):.1f} s")


def main(arguments: Sequence[str] | None = None) -> None:
    """Plan many random parts in parallel."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.random_parts", description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--pattern", default="spiral")
    parser.add_argument("--region", default="", help="auto, top, box, polygon or all; default: drawn")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--limit", type=float, default=120.0, help="processor time per part [s]")
    given = parser.parse_args(arguments)
    seeds = range(given.first_seed, given.first_seed + given.count)
    work = partial(examine, pattern=given.pattern, region=given.region, limit_s=given.limit)
    outcomes = []
    with open_workers(count=given.jobs) as workers:
        for seed, outcome, trouble in workers.results(seeds, work, lambda seed: seed):
            if outcome is None:
                print(f"seed {seed}: {trouble}", flush=True)
                continue
            outcomes.append(outcome)
            print_outcome(outcome)
    print_summary(outcomes)


if __name__ == "__main__":
    main()
