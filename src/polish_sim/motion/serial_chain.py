"""A serial chain of rigid links as arrays: what a torque model of a robot is made of.

Frame i turns with link i: its origin lies on the axis of joint i, its orientation is the body's. Frame i - 1
of the first joint is the base frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.errors import InputError
from polish_sim.kernel_cache import njit
from polish_sim.kernels import (
    add_to,
    cross,
    dot,
    kernel,
    matvec,
    plus,
    plus_cross,
    scaled,
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
    links: tuple[str, ...]
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


# Joint torques of a chain of hinges for a motion, by Newton-Euler: out and back along the links.
#
# Paper 3's recursion; the same sums as the regressor's, but of one set of parameters and without forming the
# matrix.


class ChainModel(NamedTuple):
    """A chain as the recursion takes it, with its room to work in: one for each thread."""

    geometry: ChainGeometry
    parameters: Array  #: Ten a link about its origin, shape (n, 10)
    armature: Array  #: Inertia of the rotors on the joints' side [kg m^2], shape (n,)
    turns: Array  #: Frame i in frame i - 1, shape (n, 3, 3)
    #: Angular velocity and acceleration, linear acceleration of the links' origins, shape (n + 1, 3, 3)
    motion: Array
    wrench: Array  #: Force and moment of a link about its origin, shape (n + 1, 2, 3)


def chain_model(chain: SerialChain, scale: float = 1.0) -> ChainModel:
    """Set a chain of hinges up for the recursion, masses, inertias and rotors times ``scale``.

    Raises:
        InputError: A joint is no hinge; names it.
    """
    for name, kind in zip(chain.joints, chain.geometry.kind, strict=True):
        if kind != HINGE:
            raise InputError(f"joint '{name}' is a slide: torques are computed for chains of hinges.")
    n = len(chain.joints)
    return ChainModel(
        chain.geometry, scale * chain.parameters, scale * chain.armature,
        np.zeros((n, 3, 3)), np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 2, 3)),
    )  # fmt: skip


@njit
def chain_torque(model: ChainModel, q: Array, qd: Array, qdd: Array, gravity: float, out: Array) -> None:
    """Write the torques [N m] that move the chain at q, qd, qdd, shape (n,) each, into ``out``.

    ``gravity`` is its share: 1, or 0 for the torques of inertia alone.
    """
    n = q.shape[0]
    for x in range(3):
        model.motion[0, 0, x] = model.motion[0, 1, x] = 0.0
        model.motion[0, 2, x] = -gravity * model.geometry.gravity[x]
    for j in range(n):
        _turn_link(model, j, q[j])
        _carry_motion(model, j, qd[j], qdd[j])
        _link_wrench(model.parameters[j], model.motion[j + 1], model.wrench[j + 1])
    for j in range(n - 1, -1, -1):
        z, moment = model.geometry.axis[j], model.wrench[j + 1, 1]
        out[j] = dot(z, moment) + model.armature[j] * qdd[j]
        if j:
            _carry_wrench(model, j)


@kernel
def _turn_link(model: ChainModel, j: int, angle: float) -> None:
    """R_{j-1,j}: the fixed turn, then that of the joint (Rodrigues)."""
    z, fixed, R = model.geometry.axis[j], model.geometry.rotation[j], model.turns[j]
    c, s = np.cos(angle), np.sin(angle)
    for i in range(3):
        set_to(R[i], turn_about(z, c, -s, 1.0 - c, fixed[i]))


@kernel
def _carry_motion(model: ChainModel, j: int, qd: float, qdd: float) -> None:
    """Carry the motion from link j - 1 to link j."""
    before, after = model.motion[j], model.motion[j + 1]
    R, z, p = model.turns[j].T, model.geometry.axis[j], model.geometry.position[j]
    w, dw, a = before[0], before[1], before[2]
    set_to(after[0], matvec(R, w))
    set_to(after[1], matvec(R, dw))
    set_to(after[2], matvec(R, plus_cross(plus(a, cross(dw, p)), w, cross(w, p))))
    add_to(after[1], plus(scaled(qd, cross(after[0], z)), scaled(qdd, z)))
    add_to(after[0], scaled(qd, z))


@kernel
def _link_wrench(parameters: Array, motion: Array, wrench: Array) -> None:
    """Wrench of a link about its origin: m a + dw x mc + w x (w x mc) and mc x a + I dw + w x I w."""
    w, dw, a, mc = motion[0], motion[1], motion[2], parameters[1:4]
    xx, xy, yy, xz, yz, zz = (
        parameters[4], parameters[5], parameters[6], parameters[7], parameters[8], parameters[9],
    )  # fmt: skip
    inertia = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
    set_to(wrench[0], plus(plus(scaled(parameters[0], a), cross(dw, mc)), cross(w, cross(w, mc))))
    set_to(wrench[1], plus(cross(mc, a), plus_cross(matvec(inertia, dw), w, matvec(inertia, w))))


@kernel
def _carry_wrench(model: ChainModel, j: int) -> None:
    """Add the wrench of link j to that of link j - 1."""
    R, p, need, below = model.turns[j], model.geometry.position[j], model.wrench[j + 1], model.wrench[j]
    force = matvec(R, need[0])
    add_to(below[0], force)
    add_to(below[1], matvec(R, need[1]))
    add_to(below[1], cross(p, force))
