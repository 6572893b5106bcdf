"""What the figures are computed from: the exact quantities of a run at the full rate (layer 3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Trace(NamedTuple):
    """Exact quantities at every physics step, each of shape (n,); nothing filtered, nothing late."""

    time_s: Array
    phase: NDArray[np.int8]
    """0 approach, 1 touch-down, 2 process, 3 retract, as in ``log.PHASES``."""
    normal_force_n: Array
    """Contact force along the tool axis, pressing positive."""
    position_error_m: Array
    """Distance from the tool point to its target."""
    tangential_error_m: Array
    """The part of it across the target's tool axis."""
    orientation_error_rad: Array
    """Angle between the tool's frame and its target's."""
    tcp_position_m: Array
    """Tool point in the base frame, shape (n, 3)."""
    tcp_speed_m_s: Array
    path_s_m: Array
    """Where on the path the target is."""
    part_shift_m: Array
    """How far the part has moved from where it lay at rest, base frame, shape (n, 3)."""
    pad_travel_m: Array
    """How far the head's spring is compressed."""
    spindle_rad_s: Array
    """Speed of the spindle."""
    target_error_m: Array
    """From the tool point to its target, base frame, shape (n, 3)."""
    tool_on_part_m: Array
    """Tool point in the nominal work frame of a part that a second robot carries, shape (n, 3); else zeros."""
