"""A serial chain of rigid links as arrays: what a torque model of a robot is made of (layer 6).

Frame i turns with link i: its origin lies on the axis of joint i, its orientation is the body's. Frame i - 1 of the
first joint is the base frame.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HINGE: Final = 0
SLIDE: Final = 1
LINK_PARAMETERS: Final = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Ten inertial parameters of a link about its frame's origin, in this order (paper 3)."""
LINK_UNITS: Final = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)


class ChainGeometry(NamedTuple):
    """What the compiled regressor needs of a chain."""

    kind: NDArray[np.int64]
    """HINGE or SLIDE, shape (n,)."""
    position: Array
    """Origin of frame i in frame i - 1 with the joint at zero [m], shape (n, 3)."""
    rotation: Array
    """Frame i in frame i - 1 with the joint at zero, shape (n, 3, 3)."""
    axis: Array
    """Unit axis of joint i in frame i, shape (n, 3)."""
    gravity: Array
    """In the base frame [m/s^2], shape (3,)."""


class SerialChain(NamedTuple):
    """A robot's geometry and what its model says of inertia and friction."""

    geometry: ChainGeometry
    parameters: Array
    """Ten inertial parameters a link, as `LINK_PARAMETERS`, shape (n, 10)."""
    armature: Array
    """Inertia of the rotors on the joints' side [kg m^2], shape (n,)."""
    damping: Array
    """Viscous friction [N m s/rad], shape (n,)."""
    frictionloss: Array
    """Coulomb friction [N m], shape (n,)."""
    joints: tuple[str, ...]
    links: tuple[str, ...]
    origins: Array
    """Where each frame's origin lies in the link's own body frame [m], shape (n, 3)."""


def link_parameters(mass: float, center: Array, inertia: Array) -> Array:
    """Ten parameters of a link from mass, centre and inertia about the centre.

    Args:
        mass: [kg].
        center: In the link's frame [m], shape (3,).
        inertia: About the centre, in the link's axes [kg m^2], shape (3, 3).

    Returns:
        Parameters about the frame's origin, shape (10,).
    """
    I = inertia + mass * (float(center @ center) * np.eye(3) - np.outer(center, center))  # noqa: E741
    first = mass * center
    return np.array([mass, *first, I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]])


def inertia_at_origin(parameters: Array) -> Array:
    """Inertia about the frame's origin of ten parameters [kg m^2], shape (3, 3)."""
    xx, xy, yy, xz, yz, zz = parameters[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
