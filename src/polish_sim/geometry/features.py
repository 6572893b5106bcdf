"""Creases, smooth groups and vertex normals of a mesh (faces -> one normal per vertex and smooth group)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    Ints,
    by_slices,
    crosses,
    dots,
    longest_side,
    next_corners,
    norms,
    running_sums,
    summed,
    unit,
)
from polish_sim.geometry.topology import Adjacency, corner_fans, extremes, facet_links, label_pieces

FEATURE_ANGLE = np.radians(30.0)  #: Edges that bend more than this are creases [rad]
#: Three facets across a rounding bend by 30 deg each, at a rounded corner by up to 30.5 [rad]
ROUNDED = np.radians(1.0)
#: Facets are coplanar if they deviate by less than this share of the size (float32 noise)
FLAT_TOLERANCE = 5e-7
#: At a vertex a flat face this many times wider than what it blends into keeps its own normal
FLAT_DOMINANCE = 4.0


class SmoothCorners(NamedTuple):
    """Corners of facets gathered to smooth vertices: one per vertex and smooth group."""

    ids: Ints  #: Smooth vertex of each facet corner, shape (m, 3)
    normals: Array  #: Unit normals of the smooth vertices, shape (k, 3)
    flat: Bools  #: Smooth vertices whose normal is that of a flat face, shape (k,)


def facet_normals(vertices: Array, faces: Ints | Indices) -> tuple[Array, Array]:
    """Return unit normals (m, 3) and areas (m,) [m^2] of flat facets."""
    cross = by_slices(lambda f: facet_cross(vertices[f]), faces)
    length = norms(cross)
    cross /= np.maximum(length, 1e-300)[:, None]
    return cross, 0.5 * length


def facet_cross(corners: Array) -> Array:
    """Normals of flat facets (m, 3, 3), as long as twice their areas, shape (m, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    return crosses(b - a, c - a)


def smooth_edges(normals: Array, adjacency: Adjacency, feature_angle: float = FEATURE_ANGLE) -> Bools:
    """Find which edges bend no more than the feature angle, shape (m, 3); borders do not count as smooth."""
    cosine = np.einsum("mj,mej->me", normals, normals[adjacency.facets])
    return (adjacency.facets >= 0) & (cosine > np.cos(feature_angle + ROUNDED))


def smooth_corners(
    vertices: Array, faces: Ints, adjacency: Adjacency, smooth: Bools, feature_angle: float
) -> SmoothCorners:
    """Gather facet corners across smooth edges (m, 3) and give each gathering one normal.

    Weights sin(angle) / (|e1| |e2|) make the normals exact on a sphere (Max 1999); where a much larger flat
    face meets a rounding, the flat face's own normal is kept so that it stays flat.
    """
    count, index = corner_fans(adjacency, smooth)
    normals = summed(index, by_slices(lambda f: _max_weights(vertices[f]), faces), count)
    normals, flat = _keep_flat_faces(vertices, faces, adjacency, smooth, index, normals)
    length = norms(normals)
    own, _ = facet_normals(vertices, faces)
    spare = np.empty((count, 3))
    spare[index.ravel()] = np.repeat(own, 3, axis=0)
    lost = length < 1e-12
    normals = np.where(lost[:, None], spare, normals / np.where(lost, 1.0, length)[:, None])
    # At a tip, as of a cone, no normal is near those of its facets, however smoothly they follow: each keeps
    # its own.
    tip = np.zeros(count, dtype=bool)
    tip[index[dots(normals[index], own[:, None]) < np.cos(feature_angle)]] = True
    facet, corner = np.nonzero((tip & ~flat)[index])
    index[facet, corner] = count + np.arange(len(facet))
    return SmoothCorners(
        index, np.concatenate([normals, own[facet]]), np.append(flat, np.ones(len(facet), dtype=bool))
    )


def _max_weights(corners: Array) -> Array:
    """Weighted facet normals at each corner (m, 3, 3), n sin(angle) / (|e1| |e2|), shape (m, 3, 3)."""
    ahead = next_corners(corners) - corners
    behind = np.roll(corners, 1, axis=1) - corners
    size = dots(ahead, ahead) * dots(behind, behind)
    cross = crosses(ahead[:, 0], behind[:, 0])
    return cross[:, None, :] / np.maximum(size, 1e-300)[:, :, None]


def _keep_flat_faces(
    vertices: Array, faces: Ints, adjacency: Adjacency, smooth: Bools, index: Ints, normals: Array
) -> tuple[Array, Bools]:
    """Replace normals at the rim of flat faces that dominate their vertex by the face's normal."""
    labels, areas, face_normals_ = flat_faces(vertices, faces, adjacency)
    widths = _widths(vertices, faces, adjacency, labels, areas)
    at, label = index.ravel(), np.repeat(labels, 3)
    corner_widths = widths[label]
    # The widest flat face at each smooth vertex, and the widest among the others.
    widest, second = np.zeros((2, len(normals)))
    np.maximum.at(widest, at, corner_widths)
    is_widest = corner_widths == widest[at]
    owner = np.zeros(len(normals), dtype=np.int64)
    owner[at[is_widest]] = label[is_widest]
    others = label != owner[at]
    np.maximum.at(second, at[others], corner_widths[others])
    # Where a face is alone at a vertex, what it blends into elsewhere.
    beside = np.zeros(len(widths))
    facet, edge = np.nonzero(smooth)
    other = labels[adjacency.facets[facet, edge]]
    differ = other != labels[facet]
    np.maximum.at(beside, labels[facet][differ], widths[other[differ]])
    dominates = widest > FLAT_DOMINANCE * np.where(second > 0.0, second, beside[owner])
    return np.where(dominates[:, None], face_normals_[owner], normals), dominates


def _widths(vertices: Array, faces: Ints, adjacency: Adjacency, labels: Ints, areas: Array) -> Array:
    """Mean width of flat faces, area over half the length of the rim [m], shape (k,)."""
    length = norms(next_corners(vertices[faces]) - vertices[faces])
    rim = (adjacency.facets < 0) | (labels[adjacency.facets] != labels[:, None])
    around = np.bincount(labels, weights=(length * rim).sum(axis=1), minlength=len(areas))
    return 2.0 * areas / np.maximum(around, 1e-300)


def flat_faces(vertices: Array, faces: Ints, adjacency: Adjacency) -> tuple[Ints, Array, Array]:
    """Gather coplanar neighbouring facets to flat faces.

    Returns each facet's face (m,), the faces' areas (k,) [m^2] and unit normals (k, 3). A gathering that is
    bent after all is left apart: each of its facets is a face.
    """
    normals, areas = facet_normals(vertices, faces)
    tolerance = FLAT_TOLERANCE * longest_side(vertices)
    opposite = faces[adjacency.facets, (adjacency.edges + 2) % 3]
    off_plane = np.abs(np.einsum("mej,mj->me", vertices[opposite] - vertices[faces], normals))
    facing = np.einsum("mj,mej->me", normals, normals[adjacency.facets]) > 0.0
    coplanar = (adjacency.facets >= 0) & (off_plane < tolerance) & facing
    count, labels = label_pieces(facet_links(adjacency, coplanar), len(faces))
    total, mean = _face_means(labels, areas, normals, count)
    bent = _bent_faces(vertices, faces, labels, mean, 4.0 * tolerance, count)
    if bent.any():
        alone = bent[labels]
        _, renumbered = np.unique(np.where(alone, count + np.arange(len(faces)), labels), return_inverse=True)
        labels = renumbered.astype(np.int32)
        total, mean = _face_means(labels, areas, normals, labels.max() + 1)
    return labels, total, mean


def _face_means(labels: Ints, areas: Array, normals: Array, count: int) -> tuple[Array, Array]:
    total: Array = np.bincount(labels, weights=areas, minlength=count).astype(np.float64)
    mean = summed(labels, areas[:, None] * normals, count)
    return total, unit(mean)


def _bent_faces(
    vertices: Array, faces: Ints, labels: Ints, normals: Array, tolerance: float, count: int
) -> Bools:
    """Find which gatherings leave their mean plane."""
    height = np.einsum("mcj,mj->mc", vertices[faces], normals[labels])
    low, high = extremes(labels, height.min(axis=1), height.max(axis=1), count)
    return high - low > tolerance


CORNER_ANGLE = np.radians(40.0)  #: A crease that turns by more than this at a vertex has a corner there [rad]
#: Where an edge this many times longer meets a short one, the long one is a straight line
STRAIGHT_DOMINANCE = 4.0


class SharpLines(NamedTuple):
    """Creases and borders at the vertices."""

    tangents: Array  #: Unit direction of the line through each vertex, 0 where there is none, shape (n, 3)
    through: Bools  #: Whether a line runs through the vertex without a corner, shape (n,)


def crease_tangents(
    lines: SharpLines, low: Ints, high: Ints, chords: Array, smooth: Bools
) -> tuple[Array, Array]:
    """Find the unit directions of creases and borders at the two ends of each edge, (m, 3, 3) both.

    Where a crease runs through a vertex its direction is that of the circle through the vertex and its two
    neighbours; at a corner it mirrors the edge's other end, so that the edge is an arc. On ``smooth`` edges
    (m, 3), neither crease nor border, it is the chord's. ``low``, ``high`` (m, 3): the vertices at an edge's
    ends; ``chords`` (m, 3, 3): unit vectors from one to the other.
    """
    tangent, through = lines
    start, start_known = _oriented(tangent[low], chords), through[low] & ~smooth
    end, end_known = _oriented(tangent[high], chords), through[high] & ~smooth
    start_way = np.where(start_known[..., None], start, chords)
    end_way = np.where(end_known[..., None], end, chords)
    mirrored_start = np.where((end_known & ~start_known)[..., None], _mirror(end, chords), start_way)
    mirrored_end = np.where((start_known & ~end_known)[..., None], _mirror(start, chords), end_way)
    return mirrored_start, mirrored_end


def sharp_lines(vertices: Array, faces: Ints, smooth: Bools) -> SharpLines:
    """Find the lines of the edges of facets (m, 3) that are not ``smooth`` (m, 3)."""
    count = len(vertices)
    sharp = np.unique(np.sort(np.stack([faces, next_corners(faces)], axis=-1)[~smooth], axis=1), axis=0)
    ends = np.concatenate([sharp[:, 0], sharp[:, 1]])
    others = np.concatenate([sharp[:, 1], sharp[:, 0]])
    order = np.argsort(ends, kind="stable")
    degree = np.bincount(ends, minlength=count)
    first = running_sums(degree)
    two = np.flatnonzero(degree == 2)
    before = vertices[two] - vertices[others[order[first[two]]]]
    after = vertices[others[order[first[two] + 1]]] - vertices[two]
    size_before, size_after = norms(before), norms(after)
    before, after = before / size_before[:, None], after / size_after[:, None]
    circle = before / size_before[:, None] + after / size_after[:, None]
    long_before = size_before > STRAIGHT_DOMINANCE * size_after
    long_after = size_after > STRAIGHT_DOMINANCE * size_before
    direction = np.where(long_before[:, None], before, np.where(long_after[:, None], after, circle))
    tangent = np.zeros((count, 3))
    tangent[two] = direction / np.maximum(norms(direction), 1e-300)[:, None]
    through = np.zeros(count, dtype=bool)
    through[two] = dots(before, after) > np.cos(CORNER_ANGLE)
    return SharpLines(tangent, through)


def _oriented(tangents: Array, chords: Array) -> Array:
    return np.where(dots(tangents, chords)[..., None] < 0.0, -tangents, tangents)


def _mirror(directions: Array, chords: Array) -> Array:
    """Direction at the other end of a circular arc over the chord."""
    return 2.0 * dots(directions, chords)[..., None] * chords - directions
