"""Fit the smooth surface
======================

The smooth surface of a part, beside the true sphere it was made from. Prints its errors.
"""

import numpy as np

from polish_sim import fit_surface, load_part, workpiece_path

RADIUS = 0.1  # [m]; the shipped cap is part of a sphere of 100 mm radius around (0, 0, -65) mm
MIDDLE = np.array([0.0, 0.0, -0.065])

mesh = load_part(workpiece_path("sphere_100"))
surface = fit_surface(mesh)

rng = np.random.default_rng(0)
directions = rng.normal(size=(2000, 3)) * [0.25, 0.25, 0.0] + [0.0, 0.0, 1.0]
directions /= np.linalg.norm(directions, axis=1, keepdims=True)
directions = directions[directions[:, 2] > np.cos(np.radians(30.0))]

on = surface.closest(MIDDLE + 1.05 * RADIUS * directions)
height = np.linalg.norm(on.positions - MIDDLE, axis=1) - RADIUS
angle = np.arccos(np.clip(np.sum(on.normals * directions, axis=1), -1.0, 1.0))
bend = surface.curvature(on.facets, on.barycentric)
print(f"position error: {1e9 * np.abs(height).max():.1f} nm at most (that of the flat facets: some 3000 nm)")
print(f"normal error: {np.degrees(angle).max():.4f} deg at most")
print(
    f"curvature: {np.median(bend.k1):.3f} and {np.median(bend.k2):.3f} 1/m in the middle, true is "
    f"{1.0 / RADIUS:.3f}"
)
