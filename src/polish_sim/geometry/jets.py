"""Normals and shape operators from cubic heights fitted around each vertex (neighbours -> second-order
surface data).

Facet normals averaged at a vertex are exact on a sphere but only of first order on uneven meshes and along
borders. Here every vertex fits a cubic height function to its neighbours' positions *and* normals, after
Goldfeather and Interrante (2004), with its own slope free as well, and all vertices repeat this a few times.

Where a cone runs into a rounding the curvature jumps, and no cubic fits both: the long facets of the cone
would bend. Where long edges meet short ones all normals are chosen together instead, so that the edges are
arcs that sag as little as they can.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.sparse.linalg import spsolve

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    Ints,
    dots,
    next_corners,
    norms,
    plane_axes,
    running_sums,
    summed,
    unit,
)
from polish_sim.geometry.features import SmoothCorners, facet_cross, facet_normals
from polish_sim.geometry.topology import Adjacency, extremes
from polish_sim.kernel_cache import njit
from polish_sim.kernels import dot, part, solve_positive

SWEEPS = 6  #: Repetitions; the error left over shrinks about threefold with each
_HEIGHT_WEIGHT = 9.0  # of a height against a slope, squared
_QUADRATIC_RIDGE = 1e-6
_CUBIC_RIDGE = 3e-2  # keeps the cubic terms small where there are too few neighbours
# entries of gradient, Hessian, third derivatives
_TENSOR = (1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 1.0 / 3.0, 1.0 / 3.0, 1.0)
_TRUSTED_NEEDED = 2
_LINKS_NEEDED = 3
_ROOM, _ROUGH = 3.0, 0.1  # further off than this times and plus the facets' own tilt [rad] no fit is believed
# A normal may be chosen with others where a vertex's longest edge is that many shortest ones, and a facet off
# by more than this [m]; normals that differ nowhere by more than this share of the facets' tilt are not taken
_UNEVEN, _FINE, _AGREE = 2.0, 1e-5, 0.1
_SAG = 1e-3  # weight of the sag: it only decides between arcs


class VertexJets(NamedTuple):
    """Second-order data of the surface at its smooth vertices."""

    normals: Array  #: Unit normals, shape (k, 3)
    #: Shape operators S, dn = S dx (+1/R on a sphere) [1/m], packed xx, yy, zz, xy, yz, zx, shape (k, 6)
    shape: Array


class _Links(NamedTuple):
    """Directed links between neighbouring smooth vertices, k of them."""

    first: Ints  #: The first link of each vertex and, last, the number of links, shape (k + 1,)
    here: Ints  #: Vertex that fits, rising, shape (p,)
    there: Ints  #: Its neighbour, shape (p,)
    steps: Array  #: Way from here to there in units of the mean edge at ``here``, shape (p, 3)


def fit_vertex_jets(
    vertices: Array, faces: Ints, adjacency: Adjacency, corners: SmoothCorners, smooth: Bools
) -> VertexJets:
    """Refine the normals of smooth vertices and find how the surface bends there.

    A vertex at a crease or border starts from a one-sided average; its normal is not used by others before it
    has been fitted to at least two trusted neighbours itself. Normals of flat faces stay as they are.
    ``smooth`` (m, 3) are the edges that are neither crease nor border.
    """
    links, size = _find_links(vertices, faces, corners, smooth)
    lonely = np.bincount(links.here, minlength=len(size)) < _LINKS_NEEDED
    trusted = corners.flat | ~(_at_rim(corners.ids, smooth, len(size)) | lonely)
    tilt = _widest_tilt_around(vertices, faces, corners, links)
    room = np.minimum(_ROOM * tilt, tilt + _ROUGH)
    bent = ~corners.flat & ~lonely

    normals, known = corners.normals, trusted
    for _ in range(SWEEPS if bent.any() else 0):
        frames = tangent_frames(normals)
        fitted, seen = _fit_heights(links, bent, normals, frames, known)
        able = seen >= _TRUSTED_NEEDED
        tilted = unit(normals - np.einsum("kf,kfj->kj", fitted[:, :2], frames))
        able &= norms(tilted - corners.normals) <= room
        normals = np.where(able[:, None], tilted, normals)
        known = known | able
    normals = _join_long_and_short(vertices[faces], adjacency, smooth, corners, normals, tilt)
    frames = tangent_frames(normals)
    fitted, _ = _fit_heights(links, np.ones_like(bent), normals, frames, ~lonely)
    # none where there is no neighbour
    shape = _pack(frames, -fitted[:, 2:5] / np.maximum(size, 1e-300)[:, None])
    return _lend_to_lonely(links, size, VertexJets(normals, shape), frames, fitted, lonely & ~corners.flat)


def _join_long_and_short(
    triangles: Array, adjacency: Adjacency, smooth: Bools, corners: SmoothCorners, normals: Array, tilt: Array
) -> Array:
    """Choose the normals (k, 3) where long edges meet short ones together, if that moves the surface.

    Along an edge of length L (in median lengths) the surface rises by h over the tangent plane at one end,
    and by h' over that at the other. The sum of c ((h - h')^2 + SAG L^2 (h + h')^2) is least: arcs, as even
    as they can be, and among them those that sag least. With the cotangents c of the angles opposite to an
    edge the diagonals of quadrilaterals do not count. ``tilt`` (k,) [rad]: the facets'.
    """
    ways, ends = next_corners(triangles) - triangles, np.stack([corners.ids, next_corners(corners.ids)], 2)
    lengths = np.repeat(norms(ways), 2)
    shortest, longest = extremes(ends.ravel(), lengths, lengths, len(normals))
    uneven = (longest > _UNEVEN * shortest) & (tilt * np.maximum(longest, 0.0) > 8.0 * _FINE)
    uneven[corners.ids[uneven[corners.ids].any(axis=1)]] = True
    uneven &= ~corners.flat
    if not uneven.any():
        return normals
    opposite = -dots(next_corners(ways), np.roll(ways, 1, axis=1))
    cotangents = opposite / np.maximum(norms(facet_cross(triangles)), 1e-300)[:, None]
    cotangents = cotangents + np.where(smooth, cotangents[adjacency], 0.0)
    counts = (cotangents > 0.0) & uneven[ends].any(axis=2)
    ends, ways, frames = ends[counts], ways[counts] / np.median(lengths), tangent_frames(normals)
    weights = np.column_stack([np.ones(len(ways)), _SAG * dots(ways, ways)]) * cotangents[counts, None]
    signs = np.sqrt(weights)[..., None] * [[1.0, 1.0], [1.0, -1.0]]
    slopes = np.einsum("pefj,pj->pef", frames[ends], ways)
    entries = signs[..., None] * slopes[:, None]
    columns = np.broadcast_to((2 * ends[..., None] + [0, 1])[:, None], entries.shape)
    begins = np.arange(0, entries.size + 1, 4)
    rows = csr_array((entries.ravel(), columns.ravel(), begins), (len(begins) - 1, 2 * len(normals)))
    rows = rows[:, np.flatnonzero(np.repeat(uneven, 2))]
    rises = np.einsum("pke,pej,pj->pk", signs, normals[ends], ways).ravel()
    matrix = rows.T @ rows + 1e-12 * eye_array(rows.shape[1])
    tilts = spsolve(matrix.tocsc(), -(rows.T @ rises)).reshape(-1, 2)
    found = normals.copy()
    found[uneven] = unit(normals[uneven] + np.einsum("kf,kfj->kj", tilts, frames[uneven]))
    return found if (norms(found - normals) > _AGREE * tilt).any() else normals


def _lend_to_lonely(
    links: _Links, size: Array, jets: VertexJets, frames: Array, fitted: Array, lonely: Bools
) -> VertexJets:
    """Give corners with too few neighbours the normals and shapes their neighbours' heights continue to."""
    borrow = lonely[links.here] & ~lonely[links.there]
    here, lender = links.here[borrow], links.there[borrow]
    way = -links.steps[borrow] * (size[here] / size[lender])[:, None]
    x, y = np.einsum("pfj,pj->fp", frames[lender], way)
    p, q, a, b, c, d, e, f, g = fitted[lender].T
    slope_x = p + a * x + b * y + 3.0 * d * x**2 + 2.0 * e * x * y + f * y**2
    slope_y = q + b * x + c * y + e * x**2 + 2.0 * f * x * y + 3.0 * g * y**2
    slopes = slope_x[:, None] * frames[lender, 0] + slope_y[:, None] * frames[lender, 1]
    continued = unit(jets.normals[lender] - slopes)
    normals, shape = jets.normals.copy(), np.where(lonely[:, None], 0.0, jets.shape)
    normals[here] = unit(summed(here, continued, len(normals)))[here]
    np.add.at(shape, here, jets.shape[lender] / np.bincount(here, minlength=len(size))[here][:, None])
    return VertexJets(normals, shape)


def unpack(shape: Array) -> Array:
    """Symmetric matrices (n, 3, 3) from packed ones (n, 6)."""
    return shape[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]


def _pack(frames: Array, fitted: Array) -> Array:
    first, second = frames[:, 0], frames[:, 1]
    a, b, c = fitted.T

    def entry(i: int, j: int) -> Array:
        mixed = first[:, i] * second[:, j] + second[:, i] * first[:, j]
        return a * first[:, i] * first[:, j] + b * mixed + c * second[:, i] * second[:, j]

    return np.stack([entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(1, 2), entry(2, 0)], axis=1)


def _find_links(vertices: Array, faces: Ints, corners: SmoothCorners, smooth: Bools) -> tuple[_Links, Array]:
    """Links along all edges, each once in either direction, and the mean edge length at each vertex [m]."""
    ahead_ids, way = next_corners(corners.ids), next_corners(vertices[faces]) - vertices[faces]
    here = np.concatenate([corners.ids.ravel(), ahead_ids[~smooth]])
    there = np.concatenate([ahead_ids.ravel(), corners.ids[~smooth]])
    steps = np.concatenate([way.reshape(-1, 3), -way[~smooth]])
    count = np.maximum(np.bincount(here, minlength=len(corners.normals)), 1)
    size = np.bincount(here, weights=norms(steps), minlength=len(count)) / count
    order = np.argsort(here, kind="stable")
    here, there, steps = (
        here[order],
        there[order],
        steps[order] / np.maximum(size, 1e-300)[here[order]][:, None],
    )
    return _Links(running_sums(np.bincount(here, minlength=len(size))), here, there, steps), size


def _at_rim(ids: Ints, smooth: Bools, count: int) -> Bools:
    """Smooth vertices that touch a crease or border."""
    rim = np.zeros(count, dtype=bool)
    rim[ids[~smooth]] = True
    rim[next_corners(ids)[~smooth]] = True
    return rim


def _widest_tilt_around(vertices: Array, faces: Ints, corners: SmoothCorners, links: _Links) -> Array:
    """How far first normals are from the facets' at a vertex and its neighbours, shape (k,)."""
    own, _ = facet_normals(vertices, faces)
    tilt = norms(corners.normals[corners.ids] - own[:, None, :])
    widest = np.zeros(len(corners.normals))
    np.maximum.at(widest, corners.ids.ravel(), tilt.ravel())
    around = widest.copy()
    np.maximum.at(around, links.here, widest[links.there])
    return around


def tangent_frames(normals: Array) -> Array:
    """Two unit tangents for each normal, shape (k, 2, 3)."""
    return np.stack(plane_axes(normals), axis=1)


def _fit_heights(
    links: _Links, which: Bools, normals: Array, frames: Array, trusted: Bools
) -> tuple[Array, Indices]:
    """Fit z = p x + q y + A x^2/2 + B x y + C y^2/2 + cubic terms around ``which`` vertices, lengths in mean
    edges: the coefficients, shape (k, 9), and the number of trusted neighbours, shape (k,)."""
    fitted, seen = np.zeros((len(normals), 9)), np.zeros(len(normals), np.int64)
    slopes = np.zeros((2 * np.diff(links.first).max(), 10))
    slopes[::2, 0] = slopes[1::2, 1] = 1.0
    given = np.flatnonzero(which), normals, frames, trusted, np.array(_TENSOR)
    _fit_each(links.first, links.there, links.steps, *given, slopes, fitted, seen)
    return fitted, seen


@njit
def _fit_each(  # type: ignore[no-untyped-def]
    first, there, steps, which, normals, frames, trusted, tensor, slopes, fitted, seen
):
    """Fit vertex by vertex: the height of each link's end and, of trusted neighbours, both ``slopes``, which
    hold the factors of p and q."""
    height, sums = np.empty(10), np.empty((9, 10))
    for n in range(len(which)):
        at = which[n]
        for i in range(9):
            for j in range(10):
                sums[i, j] = 0.0
        for link in range(first[at], first[at + 1]):
            other = there[link]
            step, ahead = steps[link], normals[other]
            x, y, z = dot(step, frames[at, 0]), dot(step, frames[at, 1]), dot(step, normals[at])
            a, b, c = dot(ahead, frames[at, 0]), dot(ahead, frames[at, 1]), dot(ahead, normals[at])
            far2 = x * x + y * y + z * z
            if not (c >= 0.2 and far2 > 1e-150):  # edges without length, in broken meshes
                continue
            height[0], height[1], height[2], height[3], height[4] = x, y, 0.5 * x * x, x * y, 0.5 * y * y
            height[5], height[6], height[7], height[8], height[9] = x**3, x * x * y, x * y * y, y**3, z
            _add_row(sums, height, _HEIGHT_WEIGHT / (far2 * far2))
            if trusted[other]:
                along, across = slopes[2 * seen[at]], slopes[2 * seen[at] + 1]
                seen[at] += 1
                along[2], along[3], along[5], along[6], along[7] = x, y, 3.0 * x * x, 2.0 * x * y, y * y
                across[3], across[4], across[6], across[7], across[8] = x, y, x * x, 2.0 * x * y, 3.0 * y * y
                along[9], across[9] = -a / c, -b / c
                _add_row(sums, along, 1.0 / far2)
                _add_row(sums, across, 1.0 / far2)
        # Pull the terms of each degree towards zero, alike in all directions of the tangent plane: the
        # weights are those of the squares of all entries of a symmetric tensor, which turning leaves as they
        # are.
        for begin, end, share in ((0, 2, 1e-12), (2, 5, _QUADRATIC_RIDGE), (5, 9, _CUBIC_RIDGE)):
            mean = 1e-300
            for i in range(begin, end):
                mean += sums[i, i] / tensor[i] / (end - begin)
            for i in range(begin, end):
                sums[i, i] += share * mean * tensor[i]
        solve_positive(sums, sums[:, 9], fitted[at])


@part
def _add_row(sums, row, weight):  # type: ignore[no-untyped-def]
    """Add an equation to normal equations, lower triangle and right side."""
    for i in range(9):
        scaled = weight * row[i]
        for j in range(i + 1):
            sums[i, j] += scaled * row[j]
        sums[i, 9] += scaled * row[9]
