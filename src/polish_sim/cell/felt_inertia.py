"""The inertia the wrist sensor feels is that of the motion that really happens (layer 8a).

The engine's sensors are computed from its explicit acceleration; its implicit integrator then moves the robot by
another, smaller one, because the servos damp strongly. From the first the tool would feel 1.4 times as heavy as it is.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.kernel import EngineViews

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def keep_speeds(e: EngineViews) -> None:
    """Remember the joint speeds before the engine moves on."""
    for j in range(e.speeds_before.shape[0]):
        e.speeds_before[j] = e.qvel[j]


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def correct_reading(e: EngineViews) -> None:
    """Add m (a - a_engine) of what the sensor carries to its exact reading, right after the engine's step.

    Spatial vectors are (angular; linear) about the tree's centre of mass, as the engine keeps them.
    """
    wx = wy = wz = vx = vy = vz = 0.0
    fx = fy = fz = tx = ty = tz = 0.0
    last = e.speeds_before.shape[0] - 1
    for j in range(last + 1):
        surplus = (e.qvel[j] - e.speeds_before[j]) / e.dt - e.qacc[j]
        d = e.cdof[j]
        wx, wy, wz = wx + surplus * d[0], wy + surplus * d[1], wz + surplus * d[2]
        vx, vy, vz = vx + surplus * d[3], vy + surplus * d[4], vz + surplus * d[5]
        if j < last - 1:
            continue
        # The last joint is the head's slide, the one before carries the housing.
        c = e.cinert[e.mount_body if j == last - 1 else e.head_body]
        tx += c[0] * wx + c[3] * wy + c[4] * wz + c[7] * vz - c[8] * vy
        ty += c[3] * wx + c[1] * wy + c[5] * wz + c[8] * vx - c[6] * vz
        tz += c[4] * wx + c[5] * wy + c[2] * wz + c[6] * vy - c[7] * vx
        fx += c[8] * wy - c[7] * wz + c[9] * vx
        fy += c[6] * wz - c[8] * wx + c[9] * vy
        fz += c[7] * wx - c[6] * wy + c[9] * vz
    R, p, com = e.site_xmat[e.sensor_site], e.site_xpos[e.sensor_site], e.subtree_com[e.root_body]
    rx, ry, rz = com[0] - p[0], com[1] - p[1], com[2] - p[2]
    tx, ty, tz = tx + ry * fz - rz * fy, ty + rz * fx - rx * fz, tz + rx * fy - ry * fx
    for i in range(3):
        e.sensordata[i] += R[i] * fx + R[3 + i] * fy + R[6 + i] * fz
        e.sensordata[3 + i] += R[i] * tx + R[3 + i] * ty + R[6 + i] * tz
