"""A page that shows part and path in any browser, without a network (plan -> one HTML file).

The page is `viewer.html` with the meshes put into it; it fetches nothing.
"""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Mapping
from importlib import resources
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from polish_sim.exchange.path_tube import LEAD_COLOR, PART_COLOR, VIRIDIS, Tube, path_tube
from polish_sim.exchange.setup import ExportSetup
from polish_sim.geometry.lighter_mesh import lighter_mesh
from polish_sim.planning import PlanResult

MM: Final = 1e3
MOST_FACETS: Final = 60_000
"""A finer part is shown by a lighter copy: the page stays below some 3 MB."""
FIGURES: Final[tuple[tuple[str, str, float, str], ...]] = (
    ("path in contact", "path_length_m", 1.0, "{:.2f} m"),
    ("cycle time", "cycle_time_s", 1.0, "{:.0f} s"),
    ("step-over, mean", "stepover_mean_m", MM, "{:.2f} mm"),
    ("step-over, p5", "stepover_p5_m", MM, "{:.2f} mm"),
    ("step-over, p95", "stepover_p95_m", MM, "{:.2f} mm"),
    ("covered by the pad", "coverage", 100.0, "{:.1f} %"),
    ("within 0.55 step-overs", "coverage_stepover", 100.0, "{:.1f} %"),
    ("crossings", "self_crossings", 1.0, "{:.0f}"),
    ("retracts", "retracts", 1.0, "{:.0f}"),
    ("facets of the part", "facets", 1.0, "{:.0f}"),
)
"""Rows of the page's table: name, key in metrics.json, factor, format."""


def html_text(result: PlanResult, setup: ExportSetup) -> str:
    """Write part and path as one interactive HTML page.

    Args:
        result: The plan.
        setup: Not used; every writer takes it.

    Returns:
        The page.
    """
    page = resources.files("polish_sim.exchange").joinpath("viewer.html").read_text(encoding="utf-8")
    title = html.escape(f"{result.plan.pattern} on {result.mesh.name}")
    # "<" must not appear in a script element: the part's name could close it.
    data = json.dumps(_data(result), separators=(",", ":")).replace("<", "\\u003c")
    return page.replace("@TITLE@", title).replace("@DATA@", data)


def _data(result: PlanResult) -> dict[str, Any]:
    tube = path_tube(result)
    vertices, faces = lighter_mesh(result.mesh.vertices, result.mesh.faces, MOST_FACETS)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = 0.5 * (low + high)
    return {
        "part": {
            "vertices": _packed(MM * (vertices - middle), "<f4"),
            "faces": _packed(faces, "<u4"),
            "color": PART_COLOR,
        },
        "path": _tube_data(tube, tube.contact, middle),
        "leads": _tube_data(tube, ~tube.contact, middle),
        "scale": VIRIDIS.tolist(),
        "lead_color": LEAD_COLOR,
        "length_m": result.path.length_m,
        "size_mm": MM * float(np.linalg.norm(high - low)),
        # The lighter part may stand above the path by some of its grid: the path is drawn that much nearer.
        "lift_mm": MM * 0.004 * float(np.ptp(vertices, axis=0).max()),
        "up": [float(value) for value in result.mesh.up],
        "figures": _figures(result.figures),
    }


def _tube_data(tube: Tube, kept: NDArray[np.bool_], middle: NDArray[np.float64]) -> dict[str, str]:
    """The part of the tube made of some vertices, numbered anew."""
    faces = tube.faces[kept[tube.faces].all(axis=1)]
    numbers = np.cumsum(kept) - 1
    return {
        "vertices": _packed(MM * (tube.vertices[kept] - middle), "<f4"),
        "faces": _packed(numbers[faces], "<u4"),
        "colors": _packed(tube.colors[kept], "u1"),
        "along": _packed(tube.s[kept], "<f4"),
    }


def _packed(values: NDArray[Any], kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


def _figures(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows = []
    for name, key, factor, form in FIGURES:
        value = figures.get(key)
        if value is not None:
            rows.append((name, "-" if math.isnan(value) else form.format(factor * value)))
    return rows
