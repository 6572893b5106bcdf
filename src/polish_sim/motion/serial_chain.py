"""A serial chain of rigid links as arrays: what a torque model of a robot is made of.

Frame i turns with link i: its origin lies on the axis of joint i, its orientation is the body's. Frame i - 1
of the first joint is the base frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.kernel_cache import njit
from polish_sim.kernels import (
    add_to,
    cross,
    dot,
    matvec,
    minus,
    plus,
    plus_cross,
    scaled,
    second_by_turning,
    set_to,
    turn_about,
)

HINGE = 0
SLIDE = 1
LINK_PARAMETERS = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Ten inertial parameters of a link about its frame's origin, in this order (paper 3)."""
LINK_UNITS = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)


class ChainGeometry(NamedTuple):
    """What the compiled regressor needs of a chain."""

    kind: Indices  #: HINGE or SLIDE, shape (n,)
    position: Array  #: Origin of frame i in frame i - 1 with the joint at zero [m], shape (n, 3)
    rotation: Array  #: Frame i in frame i - 1 with the joint at zero, shape (n, 3, 3)
    axis: Array  #: Unit axis of joint i in frame i, shape (n, 3)
    gravity: Array  #: In the base frame [m/s^2], shape (3,)


class SerialChain(NamedTuple):
    """A robot's geometry, inertia and friction."""

    geometry: ChainGeometry
    parameters: Array  #: Ten inertial parameters a link, as `LINK_PARAMETERS`, shape (n, 10)
    armature: Array  #: Inertia of the rotors on the joints' side [kg m^2], shape (n,)
    damping: Array  #: Viscous friction [N m s/rad], shape (n,)
    frictionloss: Array  #: Coulomb friction [N m], shape (n,)
    joints: tuple[str, ...]
    origins: Array  #: Where each frame's origin lies in the link's own body frame [m], shape (n, 3)


def link_parameters(mass: float, center: Array, inertia: Array) -> Array:
    """Ten parameters (10,) of a link about its frame's origin from mass [kg], centre and inertia about the
    centre.

    ``center`` (3,) [m] and ``inertia`` (3, 3) [kg m^2] are in the link's axes.
    """
    return np.array([mass, *(mass * center), *packed(inertia + point_inertia(mass, center))])


def point_inertia(mass: float, place: Array) -> Array:
    """Inertia of a point mass [kg] at a place (3,) [m] about the origin [kg m^2], shape (3, 3)."""
    return mass * ((place @ place) * np.eye(3) - np.outer(place, place))


def packed(inertia: Array) -> Array:
    """Entries of an inertia (3, 3) in the order of `LINK_PARAMETERS`, shape (6,)."""
    return inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]


def inertia_at_origin(parameters: Array) -> Array:
    """Inertia about the frame's origin of ten parameters [kg m^2], shape (3, 3)."""
    xx, xy, yy, xz, yz, zz = parameters[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def body_of(parameters: Array, origin: Array) -> Array:
    """Mass, centre and inertia about the centre of ten parameters about an origin (3,), shape (10,)."""
    mass = parameters[0]
    center = parameters[1:4] / parameters[0]
    return np.array(
        [mass, *(center + origin), *packed(inertia_at_origin(parameters) - point_inertia(mass, center))]
    )


# A chain's motion carried outwards, and the torque of its joints by each link's parameters (paper 3).


@njit(_nrt=False)
def step_outward(  # type: ignore[no-untyped-def]
    chain: ChainGeometry, j: int, q, qd, qdd, motion, screws
) -> None:
    """Carry motion and the joints' screws from link j - 1 to link j."""
    w, dw, a = motion[0], motion[1], motion[2]
    hinge = chain.kind[j] == HINGE
    z = chain.axis[j]
    fixed = chain.rotation[j]
    # Where the new origin lies, seen from the old one, in the old axes.
    p = plus(chain.position[j], scaled(0.0 * q if hinge else q, matvec(fixed, z)))
    # Acceleration of the new origin.
    add_to(a, second_by_turning(w, dw, p))
    # Turn back, v -> R^T v: a row of R is that of the fixed turn, turned back about the axis.
    c, s = (np.cos(q), np.sin(q)) if hinge else (1.0 + 0.0 * q, 0.0 * q)
    for x in range(3):
        set_to(motion[3 + x], turn_about(z, c, -s, 1.0 - c, fixed[x]))
    back = motion[3:6].T
    for x in range(3):
        set_to(motion[x], matvec(back, motion[x]))
    for k in range(j):
        add_to(screws[1, k], p)
        for x in range(2):
            set_to(screws[x, k], matvec(back, screws[x, k]))
    set_to(screws[0, j], z)
    set_to(screws[1, j], (0.0, 0.0, 0.0))
    # What the joint's own motion adds.
    across = cross(w, z)
    if hinge:
        add_to(dw, plus(scaled(qd, across), scaled(qdd, z)))
        add_to(w, scaled(qd, z))
    else:
        add_to(a, plus(scaled(2.0 * qd, across), scaled(qdd, z)))


@njit(forceinline=True, _nrt=False)
def fill_block(kind: int, z, arm, w, dw, a, Y, first: int) -> None:  # type: ignore[no-untyped-def]
    """Torque at a joint (axis z, arm from its origin to the link's) by the ten parameters of a link."""
    if kind == HINGE:
        n = scaled(1.0, z)
        lever = cross(z, arm)
    else:
        n = scaled(0.0, z)
        lever = scaled(1.0, z)
    Y[first] = dot(lever, a)
    # First moment: lever . (dw x c + w x (w x c)) - n . (a x c).
    turned = minus(plus(cross(lever, dw), scaled(dot(lever, w), w)), scaled(dot(w, w), lever))
    set_to(Y[first + 1 :], plus_cross(turned, a, n))
    # Inertia: n . (I dw + w x I w) = n . I dw + (n x w) . I w.
    nx, ny, nz = n
    px, py, pz = cross(n, w)
    Y[first + 4] = nx * dw[0] + px * w[0]
    Y[first + 5] = nx * dw[1] + ny * dw[0] + px * w[1] + py * w[0]
    Y[first + 6] = ny * dw[1] + py * w[1]
    Y[first + 7] = nx * dw[2] + nz * dw[0] + px * w[2] + pz * w[0]
    Y[first + 8] = ny * dw[2] + nz * dw[1] + py * w[2] + pz * w[1]
    Y[first + 9] = nz * dw[2] + pz * w[2]


class ChainModel(NamedTuple):
    """A chain whose torques are computed, with its room to work in: one for each thread."""

    geometry: ChainGeometry
    parameters: Array  #: Ten a link about its origin, shape (n, 10)
    armature: Array  #: Inertia of the rotors on the joints' side [kg m^2], shape (n,)
    motion: Array  #: Room of `step_outward`, shape (6, 3)
    screws: Array  #: The same, shape (2, n, 3)
    block: Array  #: Of `fill_block`, shape (10,)


def chain_model(chain: SerialChain, scale: float = 1.0) -> ChainModel:
    """Set a chain up for its torques, masses, inertias and rotors times ``scale``."""
    room = (np.zeros(shape) for shape in ((6, 3), (2, len(chain.joints), 3), 10))
    return ChainModel(chain.geometry, scale * chain.parameters, scale * chain.armature, *room)


@njit
def chain_torque(model: ChainModel, q: Array, qd: Array, qdd: Array, gravity: float, out: Array) -> None:
    """Write the torques [N m], of slides [N], that move the chain at q, qd, qdd, (n,) each, into ``out``.

    ``gravity`` is its share: 1, or 0 for the torques of inertia alone.
    """
    motion, screws = model.motion, model.screws
    motion[:2] = 0.0
    set_to(motion[2], scaled(-gravity, model.geometry.gravity))
    for j in range(q.shape[0]):
        out[j] = model.armature[j] * qdd[j]
        step_outward(model.geometry, j, q[j], qd[j], qdd[j], motion, screws)
        for k in range(j + 1):
            z, arm = screws[0, k], screws[1, k]
            fill_block(model.geometry.kind[k], z, arm, motion[0], motion[1], motion[2], model.block, 0)
            for x in range(10):
                out[k] += model.block[x] * model.parameters[j, x]
