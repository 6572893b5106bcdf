"""Plan a spiral
=============

A spiral on a freeform part. Prints its arrays and figures, writes results/examples/04_spiral.png.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from polish_sim import (
    PlanConfig,
    fit_surface,
    load_part,
    measure_path,
    plan_path,
    select_region,
    workpiece_path,
)

mesh = load_part(workpiece_path("freeform"))
surface = fit_surface(mesh)
region = select_region(surface, mesh)
path = plan_path(region, PlanConfig(pattern="spiral", stepover_m=0.008))

print(
    "positions [m]",
    path.positions_work.shape,
    "axes",
    path.axes_work.shape,
    "turns",
    path.pass_index.max() + 1,
)
figures = measure_path(path, region, stepover=0.008)
for name in (
    "path_length_m",
    "coverage",
    "coverage_stepover",
    "stepover_p5_m",
    "stepover_p95_m",
    "self_crossings",
):
    print(f"{name:18s} {figures[name]:.4g}")

off = np.linalg.norm(
    surface.closest(path.positions_work[path.process]).positions - path.positions_work[path.process], axis=1
)
print(f"distance to the surface: {off.max():.1e} m at most")

figure = plt.figure(figsize=(7, 6))
axes = figure.add_subplot(projection="3d")
x, y, z = 1e3 * path.positions_work[path.process].T
shown = axes.scatter(x, y, z, c=path.curvature[path.process], s=2, cmap="viridis")
axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", title="normal curvature along the path")
figure.colorbar(shown, label="[1/m]", shrink=0.7)
folder = Path("results/examples")
folder.mkdir(parents=True, exist_ok=True)
figure.savefig(folder / "04_spiral.png", dpi=120)
