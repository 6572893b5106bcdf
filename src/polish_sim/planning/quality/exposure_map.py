"""The time under the pad over a whole region, with its variation (Ground, path -> ExposureMap)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import PadConfig
from polish_sim.planning.ground.ground import Ground
from polish_sim.planning.quality.exposure import pad_steps, time_under_pad
from polish_sim.planning.quality.located import PathOnSurface
from polish_sim.planning.quality.thinning import thin

Array = NDArray[np.float64]

APART = 0.04
"""Places at which the time is summed up lie this many pad radii apart, or as far as the vertices do."""
OVER, UNDER = 2.0, 0.5
"""Over- and under-polished is what was under the pad longer (shorter) than this many medians of what it came to."""


class ExposureMap(NamedTuple):
    """Time under the pad, and what it comes to over the region's area, holes left out."""

    times: Array
    """At every vertex of the region [s], shape (v,)."""
    coverage: float
    """Share of the area with any."""
    mean_s: float
    median_s: float
    """Of what is under the pad at all."""
    variation: float
    """Standard deviation over mean."""
    over_area_m2: float
    """More than twice the median."""
    under_area_m2: float
    """Less than half of it, what is not covered included."""


def expose(ground: Ground, on: PathOnSurface, pad: PadConfig) -> ExposureMap:
    """Carry the pad along a path.

    Args:
        ground: The region.
        on: The path on it, with forces and feeds.
        pad: The pad.

    Returns:
        The times and their figures.
    """
    mesh = ground.mesh
    some = thin(mesh.vertices, APART * pad.radius_m)
    points, normals = mesh.vertices[some.kept], mesh.normals[some.kept]
    times = time_under_pad(points, normals, pad_steps(on, pad), pad.radius_m)
    own = mesh.part_areas(ground.part_facets)
    areas: Array = np.bincount(some.stands_for, weights=own, minlength=len(points)).astype(np.float64)
    total = float(areas.sum())
    mean = float((areas * times).sum()) / total
    spread = float(np.sqrt((areas * (times - mean) ** 2).sum() / total))
    under = times > 0.0
    median = _median(times[under], areas[under])
    return ExposureMap(
        times=times[some.stands_for],
        coverage=float(areas[under].sum()) / total,
        mean_s=mean,
        median_s=median,
        variation=spread / mean if mean > 0.0 else float("nan"),
        over_area_m2=float(areas[times > OVER * median].sum()),
        under_area_m2=float(areas[times < UNDER * median].sum()),
    )


def _median(values: Array, weights: Array) -> float:
    """Value below which half of the weight lies; zero if there are no values."""
    if len(values) == 0:
        return 0.0
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order[int(np.searchsorted(below, 0.5 * below[-1]))]])
