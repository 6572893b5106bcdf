"""One plan in a process of its own, its time by stage (STL -> times)."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import trimesh

from polish_sim.models.parts import Block, parts
from polish_sim.models.solids import disc_grid

FACET_SIZES = {10_000: 0.0026, 30_000: 0.00143, 100_000: 0.00078, 300_000: 0.00045, 1_000_000: 0.000246}
"""Edge of the facets [m] that gives about that many triangles."""

STAGES = {
    "read": "read_mesh_file",
    "mend": "mend",
    "turn up": "choose_up",
    "fit": "fit_surface",
    "region": "select_region",
    "triangulate": "prepare_ground",
    "plan": "plan_on",
    "measure": "measure_quality",
}
"""What takes time, and the function whose time it is."""

_PROGRAM = """
import cProfile, json, pstats, resource, sys, time
from pathlib import Path
from polish_sim.config import PartConfig, PlanConfig
from polish_sim.planning import plan_part
from polish_sim.exchange import write_plan
plan_part(PartConfig(file="plate"), PlanConfig())
profile = cProfile.Profile(time.process_time)
wall, cpu = time.perf_counter(), time.process_time()
profile.enable()
plan = plan_part(PartConfig(file=sys.argv[1]), PlanConfig(stepover_m=float(sys.argv[3])))
write_plan(Path(sys.argv[2]), plan)
profile.disable()
spent = {}
for (_, _, name), row in pstats.Stats(profile).stats.items():
    spent[name] = max(spent.get(name, 0.0), row[3])
print(json.dumps({
    "wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu, "spent": spent,
    "memory": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
    "facets": plan.figures["facets"], "length": plan.figures["path_length_m"],
}))
"""


class Timing(NamedTuple):
    """What a plan took."""

    facets: int
    stepover: float
    """[m]"""
    length: float
    """Length of the path [m]."""
    wall: float
    """From the STL to the files on disk, kernels compiled before [s]."""
    cpu: float
    """The same, time on the processor [s]."""
    memory: int
    """Peak memory of the process [bytes]."""
    stages: dict[str, float]
    """CPU time by stage [s]."""


def sampled_freeform(folder: Path, facet_size: float) -> Path:
    """Write ``freeform`` sampled with facets of this size [m] as an STL."""
    path = folder / "large.stl"
    solid = Block(parts()["freeform"].shape, disc_grid(0.100, facet_size)).build()
    trimesh.Trimesh(1e3 * solid.vertices, solid.faces, process=False).export(path)
    return path


def time_plan(part: Path, folder: Path, stepover: float = 0.008) -> Timing:
    """Plan a part with warm kernels in a process of its own.

    Args:
        part: STL in mm.
        folder: Where the plan is written.
        stepover: Step-over [m].

    Returns:
        Times and memory.
    """
    command = [sys.executable, "-c", _PROGRAM, str(part), str(folder), str(stepover)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    said = json.loads(run.stdout)
    stages = {name: float(said["spent"].get(function, 0.0)) for name, function in STAGES.items()}
    return Timing(said["facets"], stepover, said["length"], said["wall"], said["cpu"], said["memory"], stages)
