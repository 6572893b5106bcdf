"""Length units of STL files, which say none themselves, and the check that the chosen one is plausible."""

from __future__ import annotations

from pathlib import Path

from polish_sim.errors import MeshError, unknown_name

METRES_PER_UNIT = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}
"""Length of one file unit [m]."""

SMALLEST_PART = 5e-3
"""Largest extent of the smallest part one could polish [m]."""

LARGEST_PART = 2.0
"""Largest extent of the largest part [m]."""

_ROUNDING = 1e-6
"""Of numbers in a file, relative."""


def metres_per_unit(unit: str) -> float:
    """Return the length of one file unit [m]; unknown names are an error that lists the known ones."""
    if unit not in METRES_PER_UNIT:
        raise unknown_name("unit", unit, METRES_PER_UNIT)
    return METRES_PER_UNIT[unit]


def check_size(extent: float, unit: str, path: Path) -> None:
    """Refuse a part that is implausibly small or large in the chosen unit.

    Args:
        extent: Largest side of the part's bounding box, in the file's own unit.
        unit: The chosen unit.
        path: The file, for the message.

    Raises:
        MeshError: The part is not between 5 mm and 2 m; names the units that would fit.
    """
    size = extent * metres_per_unit(unit)
    if _plausible(size):
        return
    fitting = [name for name, metres in METRES_PER_UNIT.items() if _plausible(extent * metres)]
    problem = "small" if size < SMALLEST_PART else "large"
    advice = (
        "Is the unit right? These would fit: " + ", ".join(f"--units {name}" for name in fitting) + "."
        if fitting
        else "No known unit fits: scale the part."
    )
    raise MeshError(
        f"{path}: the part is too {problem}: {extent:.6g} {unit} at its largest "
        f"(wanted: {SMALLEST_PART * 1e3:g} to {LARGEST_PART * 1e3:g} mm). {advice}"
    )


def _plausible(size: float) -> bool:
    """Whether a part of this size [m] could be polished; a limit that is met but for rounding is met."""
    return SMALLEST_PART * (1.0 - _ROUNDING) <= size <= LARGEST_PART * (1.0 + _ROUNDING)
