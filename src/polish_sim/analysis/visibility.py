"""Which points of a picture the part itself stands before: a depth picture of its facets (layer 8c)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Projection = Callable[[Array], Array]
"""Points (n, 3) to places in the picture and depths, larger is nearer, (n, 3); straight lines stay straight."""

PIXELS = 250
"""Of a depth picture, along the longer side of the part."""
APART = 0.75
"""Pixels between samples of a facet, at most."""
LIFT = 2.0
"""Pixels by which points are taken off the surface: more than depths within a pixel of a plane differ."""
SAMPLES_AT_ONCE = 2_000_000


class DepthPicture(NamedTuple):
    """The part as a viewer sees it."""

    project: Projection
    low: Array
    """Corner of the picture, shape (2,)."""
    pixel: float
    """Side of a pixel in the picture's own unit."""
    depth: Array
    """Depth of what is seen in each pixel, minus infinity beside the part, shape (columns, rows)."""
    lift: float
    """Way off the surface that keeps it from hiding its own points, in the unit of the points."""


def depth_picture(corners: Array, project: Projection) -> DepthPicture:
    """Draw the depths of a part.

    Args:
        corners: Corners of its facets, shape (m, 3, 3).
        project: The picture.

    Returns:
        The picture; depths are exact at samples of the facets, less than a pixel apart.
    """
    points = corners.reshape(-1, 3)
    seen = project(points).reshape(-1, 3, 3)
    low, high = seen[..., :2].min(axis=(0, 1)), seen[..., :2].max(axis=(0, 1))
    pixel = float((high - low).max()) / PIXELS
    depth = np.full(tuple(np.ceil((high - low) / pixel).astype(int) + 1), -np.inf)
    for samples in _samples(seen, APART * pixel):
        columns, rows = ((samples[:, :2] - low) / pixel).astype(int).T
        np.maximum.at(depth.ravel(), columns * depth.shape[1] + rows, samples[:, 2])
    lift = LIFT * float(np.linalg.norm(np.ptp(points, axis=0))) / PIXELS
    return DepthPicture(project, low, pixel, depth, lift)


def seen_in(picture: DepthPicture, points: Array, off: Array) -> NDArray[np.bool_]:
    """Whether points are before the part or beside it.

    Args:
        picture: The part.
        points: On the part or off it, shape (n, 3).
        off: Unit vectors away from the part, shape (n, 3).

    Returns:
        Shape (n,).
    """
    places = picture.project(points + picture.lift * off)
    columns, rows = np.floor((places[:, :2] - picture.low) / picture.pixel).astype(int).T
    width, height = picture.depth.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    before = np.full(len(points), True)
    before[inside] = places[inside, 2] >= picture.depth[columns[inside], rows[inside]]
    return before


def _samples(seen: Array, apart: float) -> Iterator[Array]:
    """Points on triangles (m, 3, 3), at most so far apart, some at a time, (k, 3)."""
    edges = np.linalg.norm(seen[:, :, :2] - np.roll(seen[:, :, :2], 1, axis=1), axis=2).max(axis=1)
    # Powers of two, so that few sets of weights are needed.
    steps = 2 ** np.ceil(np.log2(np.maximum(edges / apart, 1.0))).astype(int)
    for count in np.unique(steps):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
        within = i + j <= count
        weights = np.column_stack([i[within], j[within], count - i[within] - j[within]]) / count
        chosen = np.flatnonzero(steps == count)
        for part in np.array_split(chosen, -(-len(chosen) * len(weights) // SAMPLES_AT_ONCE)):
            yield (weights @ seen[part]).reshape(-1, 3)
