"""Inspect a path made elsewhere
=============================

A path made elsewhere, here rings in numpy, read from a plain CSV and measured. Prints its figures and notes.
"""

from pathlib import Path

import numpy as np

from polish_sim import PartConfig, inspect_path, read_path

# Rings 6 mm apart on the sphere cap, its axis the outward normal; mm, as CAM systems write.
rings = []
for steep in np.arange(0.06, 0.56, 0.06):
    around = np.linspace(0.0, 2.0 * np.pi, int(200 * np.sin(steep)) + 12, endpoint=False)
    level = np.full_like(around, np.cos(steep))
    rings.append(np.stack([np.sin(steep) * np.cos(around), np.sin(steep) * np.sin(around), level], axis=1))
normals = np.concatenate(rings)
points = np.array([0.0, 0.0, -65.0]) + 100.0 * normals

file = Path("results/examples/06_rings.csv")
file.parent.mkdir(parents=True, exist_ok=True)
np.savetxt(file, np.hstack([points, normals]), fmt="%.9f", delimiter=",", header="x,y,z,i,j,k", comments="")

inspection = inspect_path(read_path(file), PartConfig("sphere_100"))
for name in (
    "path_length_m",
    "coverage",
    "coverage_stepover",
    "stepover_mean_m",
    "self_crossings",
    "max_axis_rate_rad_m",
):
    print(f"{name:20s} {inspection.figures[name]:.4g}")
for note in inspection.notes:
    print("note:", note)
