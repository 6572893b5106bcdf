"""What lies ahead on the path, as a controller may know it before the run (layer 7).

Everything here comes from the drawing: the nominal part, pad and springs as they should be. What the real part, the
real springs and the sensor do differently, a controller has to find out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Course(NamedTuple):
    """Rows at equal steps of the plan's arc length; ``target.path[0]`` divided by ``spacing`` is the row."""

    spacing: float
    """Arc length between rows [m]."""
    depth: Array
    """Depth along the tool axis, from the unpressed surface, at which springs and pad press with the wanted force [m],
    shape (n,)."""
    surplus: Array
    """That depth beyond the planned target's [m], shape (n,); zero where the whole pad lies flat on the part."""
    stiffness: Array
    """Change of the force with that depth, head spring and touching part of the pad in series [N/m], shape (n,)."""
    moment: Array
    """Moment of the pad's pressure on the part about tool x and y through the middle of the pad's face [N m], shape
    (n, 2). Friction acts in that face and has no part in it."""
    tilt_stiffness: Array
    """Change of that moment with a tilt of the tool about its own axis at the same force [N m/rad], shape (n, 2)."""
    curvature: Array
    """Normal curvature along the path [1/m], shape (n,)."""
    bending: Array
    """Curvature of the planned path in space [1/m], shape (n,)."""
    turning: Array
    """Planned rotation of the tool per arc length, base frame [rad/m], shape (n, 3)."""
    feed: Array
    """Speed of the planned motion along the path, slowed where its limits ask for it [m/s], shape (n,)."""
    neighbour: NDArray[np.int64]
    """Row of the nearest place on an earlier turn, -1 where there is none within about a step-over, shape (n,)."""
