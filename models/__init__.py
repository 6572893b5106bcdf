"""Where the shipped models are: the robot's MJCF and the workpieces' STL files (read by the cell and the planner)."""

from __future__ import annotations

from pathlib import Path

from polish_sim.errors import unknown_name

_FOLDER = Path(__file__).resolve().parent


def robot_model_path() -> Path:
    """Path of the MJCF of the UR5e with wrist sensor, spindle and compliant head."""
    return _FOLDER / "ur5e_spindle.xml"


def workpiece_names() -> tuple[str, ...]:
    """Names of the shipped workpieces, sorted."""
    return tuple(sorted(path.stem for path in (_FOLDER / "workpieces").glob("*.stl")))


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


__all__ = ["robot_model_path", "workpiece_names", "workpiece_path"]
