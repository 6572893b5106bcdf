"""Compare patterns
================

Four patterns on a plate with two holes. Prints a table: which one lifts, which one is long, which one is
even.
"""

from polish_sim import (
    fit_surface,
    load_part,
    measure_path,
    plan_contour,
    plan_fermat,
    plan_raster,
    plan_spiral,
    select_region,
    workpiece_path,
)

STEPOVER = 0.008  # [m]
mesh = load_part(workpiece_path("plate_two_holes"))
region = select_region(fit_surface(mesh), mesh)

print("pattern   length [m]  lifts  crossings  within 0.55 step-overs  step-over p5 and p95 [mm]")
for plan in (plan_spiral, plan_contour, plan_fermat, plan_raster):
    m = measure_path(plan(region, STEPOVER), region, STEPOVER)
    counts = f"{m['path_length_m']:10.2f} {m['retracts']:6d} {m['self_crossings']:10d}"
    spread = f"{1e3 * m['stepover_p5_m']:.2f} {1e3 * m['stepover_p95_m']:.2f}"
    print(f"{plan.__name__[5:]:9s} {counts} {100 * m['coverage_stepover']:21.1f} %  {spread}")
