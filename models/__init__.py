"""Where the shipped models are: the robot's MJCF and the workpieces' STL files (read by the cell and the
planner)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from polish_sim.errors import InputError, did_you_mean, unknown_name
from polish_sim.workers import local_copy

_FOLDER = Path(__file__).resolve().parent

WORKPIECES: Mapping[str, str] = MappingProxyType(
    {
        "cylinder": "part of a cylinder, R = 150 mm, up to 32 deg steep",
        "freeform": "dome with six rounded folds like spokes, for the paper's part",
        "plate": "plane",
        "plate_ramp": "the plate with a ramp of 8 deg",
        "plate_step": "the plate with an edge of 1 mm across",
        "plate_two_holes": "plane with two holes",
        "saddle": "saddle",
        "sphere_100": "cap of a sphere, R = 100 mm",
        "sphere_300": "cap of a sphere, R = 300 mm",
        "sphere_50": "cap of a sphere, R = 50 mm",
        "wheel_hub_rim": "crowned ring around a web with a bore",
    }
)
"""The shipped workpieces and what is on top of each; README.md has their measures."""


def robot_model_path() -> Path:
    """Path of the MJCF of the UR5e with wrist sensor, spindle and compliant head."""
    return _FOLDER / "ur5e_spindle.xml"


def workpiece_names() -> tuple[str, ...]:
    """Names of the shipped workpieces, sorted."""
    return tuple(WORKPIECES)


def workpiece_path(name: str) -> Path:
    """Path of a shipped workpiece's STL (mm, z up).

    Args:
        name: One of `workpiece_names()`.

    Returns:
        The file's path.

    Raises:
        InputError: The name is not shipped; the message lists the known ones.
    """
    if name not in workpiece_names():
        raise unknown_name("workpiece", name, workpiece_names())
    return _FOLDER / "workpieces" / f"{name}.stl"


def part_path(name: str) -> Path:
    """File of a part: a shipped one by its name, anything else as a path.

    Args:
        name: What the user calls the part.

    Returns:
        The path; whether there is such a file shows when it is read.

    Raises:
        InputError: A bare name that is neither a shipped part nor a file; lists the shipped ones, the
            likeliest first. A name that no text file can hold.
    """
    if name != name.encode(errors="ignore").decode():
        raise InputError(f"the name of the file {name!a} is not UTF-8. Rename the file.")
    if name in workpiece_names():
        return workpiece_path(name)
    path = Path(local_copy(name))
    if path.suffix or path.name != name or path.exists():
        return path
    meant = did_you_mean(name, workpiece_names())
    raise InputError(
        f"'{name}' is neither a file nor a shipped part.{meant} Shipped: {', '.join(workpiece_names())}."
    )


__all__ = ["WORKPIECES", "part_path", "robot_model_path", "workpiece_names", "workpiece_path"]
