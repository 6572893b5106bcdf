"""The arms by their tables: everything the code knows of one make and not of another.

Sources of every number: models/README.md. A further arm of this build (three parallel axes, a wrist whose
axes do not meet) is a row of `ARMS`; docs/new_arm.md says what it needs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

Six = tuple[float, float, float, float, float, float]


class ArmLink(NamedTuple):
    """A link in its own Denavit-Hartenberg frame, and the capsule it is drawn and collides as."""

    mass: float  #: [kg]
    center: tuple[float, float, float]  #: Of mass [m]
    inertia: Six  #: About it: xx, yy, zz, xy, xz, yz [kg m^2]
    capsule: Six  #: From, to [m]
    radius: float  #: Of the capsule [m]


class ArmTable(NamedTuple):
    """One make of arm."""

    label: str
    type_number: int  #: As the robot's controller reports it
    d: Six  #: Offsets along the joints' axes [m]
    a: Six  #: Lengths of the links [m]
    speed: Six  #: Largest of each joint [rad/s]
    torque: Six  #: Largest of each joint [N m]
    torque_constants: Six  #: Torque behind the gear by the motor's current [N m/A]
    stiff: Six  #: Servos' gains by angle [N m/rad]
    damped: Six  #: and by speed [N m s/rad]
    links: tuple[ArmLink, ...] = ()  #: Of joints 1 to 6; empty: those of the model file
    #: Keys of [robot.real] that differ from the defaults
    gears: Mapping[str, tuple[float, ...]] = {}


def _sizes(first: float, second: float, elbow: float, wrist: float) -> Six:
    return first, second, elbow, wrist, wrist, wrist


_UR5E = ArmTable(
    label="UR5e",
    type_number=1,
    d=(0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996),
    a=(0.0, -0.425, -0.3922, 0.0, 0.0, 0.0),
    speed=(3.141592653589793,) * 6,
    torque=_sizes(150.0, 150.0, 150.0, 28.0),
    torque_constants=(11.7, 11.7, 11.2, 9.1, 9.1, 9.1),
    stiff=_sizes(2e5, 2e5, 2e5, 3e4),
    damped=_sizes(1600.0, 1600.0, 1600.0, 220.0),
)
_UR10E = ArmTable(
    label="UR10e",
    type_number=2,
    d=(0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655),
    a=(0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0),
    speed=(2.0943951023931953,) * 2 + (3.141592653589793,) * 4,
    torque=_sizes(330.0, 330.0, 150.0, 56.0),
    torque_constants=(11.976, 11.976, 9.839, 10.763, 10.763, 11.333),
    stiff=_sizes(4e5, 4e5, 2e5, 6e4),
    damped=_sizes(3200.0, 3200.0, 1600.0, 440.0),
    links=(
        ArmLink(7.369, (0.021, 0.0, 0.027), (0.0341, 0.0353, 0.0216, 0.0, -0.0043, 0.0001),
                (0.0, -0.03, 0.0, 0.0, 0.0, 0.03), 0.075),
        ArmLink(13.051, (0.38, 0.0, 0.158), (0.0281, 0.7707, 0.7694, 0.0001, -0.0156, 0.0),
                (0.6127, 0.0, 0.175, 0.0, 0.0, 0.175), 0.070),
        ArmLink(3.989, (0.24, 0.0, 0.068), (0.0101, 0.3093, 0.3065, 0.0001, 0.0092, 0.0),
                (0.57155, 0.0, 0.045, 0.0, 0.0, 0.045), 0.056),
        ArmLink(2.1, (0.0, 0.007, 0.018), (0.0030, 0.0022, 0.0026, 0.0, 0.0, -0.0002),
                (0.0, -0.03, 0.0, 0.0, 0.005, 0.0), 0.055),
        ArmLink(1.98, (0.0, 0.007, 0.018), (0.0030, 0.0022, 0.0026, 0.0, 0.0, -0.0002),
                (0.0, 0.02, 0.0, 0.0, -0.005, 0.0), 0.055),
        ArmLink(0.615, (0.0, 0.0, -0.026), (0.0003, 0.0004, 0.0003, 0.0, 0.0, 0.0),
                (0.0, 0.0, -0.04, 0.0, 0.0, -0.02), 0.045),
    ),
    gears={
        "stiffness_1_nm_rad": _sizes(67e3, 67e3, 31e3, 16e3),
        "stiffness_2_nm_rad": _sizes(110e3, 110e3, 50e3, 25e3),
        "stiffness_3_nm_rad": _sizes(120e3, 120e3, 57e3, 29e3),
        "knee_1_nm": _sizes(29.0, 29.0, 14.0, 7.0),
        "knee_2_nm": _sizes(108.0, 108.0, 48.0, 25.0),
        "damping_nm_s_rad": _sizes(40.0, 40.0, 20.0, 7.0),
        "rotor_kg_m2": _sizes(5.9, 5.9, 1.92, 0.6),
        "gear_error_rad": (4.2e-5, 1.35e-5, 1.65e-5, 2.9e-4, 2.9e-4, 2.9e-4),
        "viscous_nm_s_rad": (23.3, 20.4, 9.0, 3.55, 2.3, 3.2),
        "coulomb_nm": (16.8, 11.8, 5.3, 2.8, 3.3, 2.75),
    },
)  # fmt: skip
ARMS: Mapping[str, ArmTable] = {"ur5e": _UR5E, "ur10e": _UR10E}
"""By the word of ``robot.arm``; the model file draws the first."""
IDEAL = "ideal"  #: The first one with rigid gears, exact encoders and an exact table
FIRST = next(iter(ARMS))


def arm_table(name: str) -> ArmTable:
    """The arm that a word of ``robot.arm`` names; `take_arm` refuses unknown words."""
    return ARMS.get(name, ARMS[FIRST])
