"""Section [part] of the scenario (layer 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class PartConfig:
    """Which part is in the cell, where, and how it differs from its drawing."""

    file: str = key("freeform", "STL, PLY or OBJ file, or the name of a shipped part")
    real_file: str = key(
        "",
        "mesh of the part as it really is (file or shipped part, unit and frame of the nominal one): path from `file`, "
        "contact with this; empty = as drawn",
    )
    unit: str = key("mm", "unit of the part's file: mm, cm, m or inch")
    up: str = key("auto", "side turned up: auto, x, y, z, -x, -y, -z, or a direction X,Y,Z")
    pose: tuple[float, ...] = key(
        (), "pose of the work frame in the base frame: x, y, z [m], rotation vector [rad]; empty = chosen", length=6
    )
    displacement_m: float = key(0.001, "how far the real part sits from its nominal place [m]", 0.0, 0.02)
    rotation_rad: float = key(math.radians(0.5), "how far the real part is turned [rad]", 0.0, 0.2)
    form_error_m: float = key(0.0003, "form error of the real part, peak to peak [m]", 0.0, 0.005)
    motion_m: float = key(0.0, "the part moves along its mean normal by a sine of this amplitude [m]", 0.0, 0.02)
    motion_hz: float = key(1.0, "frequency of that motion [Hz]", 0.0, 50.0)
