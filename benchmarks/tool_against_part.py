"""`python -m benchmarks.tool_against_part`: no body of the tool shares volume with the part along 50 plans.

Independent of the planner: the model's own meshes of shaft, spindle, sensor and wrist, and the pad above what
it is compressed by, are intersected with the part's mesh by manifold3d at places all along each path, pressed
and in the air.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

from benchmarks.field_shapes import parts
from benchmarks.random_draw import draw_part
from polish_sim.arrays import Array
from polish_sim.config import PadConfig, PlanConfig
from polish_sim.errors import PolishSimError
from polish_sim.geometry import PartMesh, load_part
from polish_sim.planning import PlanResult, plan_mesh
from polish_sim.planning.quality.located import ground_under
from polish_sim.planning.quality.tool_room import pressed_places
from tests.planning.test_tool_room import CASES
from tests.planning.tools import volumes_in_part

PATTERNS = ("spiral", "raster", "contour", "fermat")
YIELDS_M = 20.0 / 20000.0
"""Compression of the pad at 20 N."""
SHARED_MM3 = 0.05
"""Volume in common that is rounding: of a triangle against the smooth surface through its corners."""
PLACES = 300
"""Places looked at along a path, at most."""


class Trial(NamedTuple):
    """A plan to make, and the part's closed mesh it is held against."""

    name: str
    solid: trimesh.Trimesh
    mesh: PartMesh
    plan: PlanConfig
    pad: PadConfig


def trials(folder: Path, seed: int) -> Iterator[Trial]:
    """Parts of the field, parts with walls around them, and random parts, each with the next pattern."""
    rng = np.random.default_rng(seed)
    walled = {name: (make, region) for name, (make, region, _) in CASES.items()}
    field = {name: (make, "auto") for name, make in parts().items()}
    for name, (make, region) in [*walled.items(), *field.items()]:
        solid = make()
        solid.export(folder / f"{name}.stl")
        mesh = load_part(folder / f"{name}.stl", "mm", "z")
        for pattern in rng.permutation(PATTERNS)[: 2 if name in walled else 1]:
            diameter = float(rng.choice([0.012, 0.02, 0.03, 0.05]))
            plan = PlanConfig(pattern=str(pattern), region=region, stepover_m=0.25 * diameter)
            yield Trial(name, solid, mesh, plan, PadConfig(radius_m=0.5 * diameter, choice="given"))
    for number in range(1000):
        part = draw_part(seed + number, PATTERNS[number % 4], "")
        vertices = 1e3 * part.solid.vertices
        solid = trimesh.Trimesh(vertices, part.solid.faces, process=False)
        solid.export(folder / "random.stl")
        mesh = replace(load_part(folder / "random.stl", "mm", "z"), up=part.up)
        yield Trial(
            f"{seed + number}: {part.name}", solid, mesh, part.plan, replace(part.pad, choice="given")
        )


def compression(result: PlanResult) -> Array:
    """How far the pad is compressed by the force and by the bend of the ground right under it, (n,) [m]."""
    path = result.path
    foot = result.surface.closest(path.positions_work)
    under = ground_under(result.surface, foot)
    places = pressed_places(path.positions_work, path.axes_work, under, result.tool.pad, result.tool.force)
    return np.maximum(places.lows, YIELDS_M)


def main() -> None:
    """Print each plan's largest volume in common with the part."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tool_against_part", description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="plans")
    parser.add_argument("--seed", type=int, default=90001)
    parser.add_argument("--only", default="", help="a word of the part's name")
    given = parser.parse_args()
    done, bad = 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for trial in trials(Path(folder), given.seed):
            if given.only not in trial.name:
                continue
            if done >= given.count:
                break
            label = f"{trial.name[:40]:40s} {trial.plan.pattern:8s} pad {2e3 * trial.pad.radius_m:4.1f} mm"
            if not trial.solid.is_volume:
                print(f"{label} left out: no closed mesh", flush=True)
                continue
            try:
                result = plan_mesh(trial.mesh, trial.plan, pad=trial.pad)
            except PolishSimError as error:
                print(f"{label} refused: {str(error)[:90]}", flush=True)
                continue
            apart = max(4e-3, result.path.s[-1] / PLACES)
            shared = volumes_in_part(result.path, trial.solid, trial.pad.radius_m, compression(result), apart)
            done, bad = done + 1, bad + (max(shared.values()) > SHARED_MM3)
            worst = max(shared, key=lambda name: shared[name])
            print(
                f"{label} {shared[worst]:8.3f} mm^3 {worst if shared[worst] > SHARED_MM3 else ''}", flush=True
            )
    print(f"{done} plans, {bad} with more than {SHARED_MM3:g} mm^3 of a body of the tool in the part")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
