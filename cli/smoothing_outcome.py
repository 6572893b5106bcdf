"""What a smoothed path is shown by on the terminal; imported only inside commands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from polish_sim.cli import console
from polish_sim.smoothing.figures import ORDERS

MM, MICRO = 1e3, 1e6


class SmoothOutcome(NamedTuple):
    """A smoothed path."""

    name: str
    figures: Mapping[str, Any]
    notes: Sequence[str]

    def show(self) -> None:
        """Print notes and the table of figures."""
        for text in self.notes:
            console.note(f"note: {text}")
        columns = [self.figures] + ([self.figures["against"]] if "against" in self.figures else [])
        rows = [[label, unit, *(text(m) for m in columns)] for label, unit, text in _ROWS]
        rows += [
            _time_row(rule, seconds, len(columns)) for rule, seconds in self.figures["cycle_time_by_rule_s"].items()
        ]
        console.table(f"{self.name}, smoothed", ["figure", "unit", *(m["rule"] for m in columns)], rows, left=1)


def _time_row(rule: str, seconds: float | None, columns: int) -> list[str]:
    return [f"cycle time by {rule}", "s", "-" if seconds is None else f"{seconds:.3f}", *[""] * (columns - 1)]


def _ratio(name: str) -> Any:
    return lambda m: "-" if m[name] is None else f"{m[name]:.4f}"


def _shares(part: str) -> list[tuple[str, str, Any]]:
    return [(f"{part} {order}, peak / limit", "", _ratio(f"{part}_{order}_ratio_max")) for order in ORDERS]


_ROWS: list[tuple[str, str, Any]] = [
    ("segments", "", lambda m: str(m["segments"])),
    ("  after short ones are joined", "", lambda m: str(m["segments_planned"])),
    ("path length", "mm", lambda m: f"{MM * m['path_length_m']:.1f}"),
    ("cycle time", "s", lambda m: f"{m['cycle_time_s']:.3f}"),
    ("tip off the path, at most", "µm", lambda m: f"{MICRO * m['tip_deviation_contour_max_m']:.2f}"),
    ("corner off the tip's way, at most", "µm", lambda m: f"{MICRO * m['tip_deviation_vertex_max_m']:.2f}"),
    ("tool axis off its path, at most", "deg", lambda m: f"{math.degrees(m['axis_deviation_max_rad']):.4f}"),
    *_shares("tool"),
    *_shares("axis"),
    *_shares("joint"),
    ("planned, segments per second", "1/s", lambda m: f"{m['segments_per_s']:.0f}"),
]
