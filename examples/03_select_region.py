"""Select the region to polish
===========================

What is to be polished: chosen automatically, by a point, by a box, with a margin. Prints areas and borders.
"""

from polish_sim import fit_surface, load_part, select_region, workpiece_path

mesh = load_part(workpiece_path("plate_two_holes"))
surface = fit_surface(mesh)

for choice in ("auto", "top", "point:80,0,20", "box:-100,-80,15,0,80,25"):
    region = select_region(surface, mesh, choice)
    print(f"{choice:26s} {1e4 * region.area_m2:6.1f} cm2, {len(region.boundary_loops)} borders")

kept = select_region(surface, mesh, "auto", edge_margin=0.01)
print(f"{'auto, 10 mm off the edges':26s} {1e4 * kept.area_m2:6.1f} cm2, {len(kept.boundary_loops)} borders")
print("outer border:", kept.boundary_loops[0].shape, "points [m]")
