"""Compare patterns
================

Four patterns on a plate with two holes. Prints a table: which one lifts, which one is long, which one is
even.
"""

import matplotlib.pyplot as plt

from polish_sim import (
    PlanConfig,
    fit_surface,
    load_part,
    measure_path,
    plan_path,
    select_region,
    workpiece_path,
)

STEPOVER = 0.008  # [m]
mesh = load_part(workpiece_path("plate_two_holes"))
region = select_region(fit_surface(mesh), mesh)

print("pattern   length [m]  lifts  crossings  within 0.55 step-overs  step-over p5 and p95 [mm]")
figure, drawn = plt.subplots(2, 2, figsize=(8, 7), layout="constrained", sharex=True, sharey=True)
for pattern, axes in zip(("spiral", "contour", "fermat", "raster"), drawn.flat, strict=True):
    path = plan_path(region, PlanConfig(pattern=pattern, stepover_m=STEPOVER))
    m = measure_path(path, region, STEPOVER)
    counts = f"{m['path_length_m']:10.2f} {m['retracts']:6d} {m['self_crossings']:10d}"
    spread = f"{1e3 * m['stepover_p5_m']:.2f} {1e3 * m['stepover_p95_m']:.2f}"
    print(f"{pattern:9s} {counts} {100 * m['coverage_stepover']:21.1f} %  {spread}")
    x, y = 1e3 * path.positions_work[:, :2].T
    axes.plot(x, y, color="0.75", linewidth=0.6)  # with the ways through the air
    axes.scatter(x[path.process], y[path.process], s=1)
    axes.set(title=pattern, aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
plt.show()
