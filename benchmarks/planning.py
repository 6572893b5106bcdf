"""Time and memory from a large STL to a path on disk, in a process of its own."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.table import Row
from polish_sim.models.parts import Block, parts
from polish_sim.models.solids import disc_grid

FACET_SIZE = 0.00078  # [m]

_PROGRAM = """
import resource, sys, time
from polish_sim.kernel_cache import use_kernel_cache
use_kernel_cache()
from polish_sim.config import PartConfig, PlanConfig
from polish_sim.exchange import write_plan
from polish_sim.planning import plan_part
from pathlib import Path
plan_part(PartConfig(file="plate"), PlanConfig())
begin = time.perf_counter()
plan = plan_part(PartConfig(file=sys.argv[1]), PlanConfig())
write_plan(Path(sys.argv[2]), plan)
print(time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6, plan.figures["facets"])
"""


def measure() -> Iterator[Row]:
    """Plan ``freeform`` sampled finely, with warm kernels."""
    with tempfile.TemporaryDirectory() as folder:
        part = Path(folder) / "large.stl"
        solid = Block(parts()["freeform"].shape, disc_grid(0.100, FACET_SIZE)).build()
        trimesh.Trimesh(1e3 * solid.vertices, solid.faces).export(part)
        facets = len(solid.faces)
        run = subprocess.run(
            [sys.executable, "-c", _PROGRAM, str(part), folder], capture_output=True, text=True, check=True
        )
        seconds, gigabytes, used = np.array(run.stdout.split(), dtype=float)
    yield Row(f"{facets} triangles ({used:.0f} after checks): time", f"{seconds:.1f} s", "10 s")
    yield Row("peak memory of the process", f"{gigabytes:.2f} GB", "1 GB")
