"""Find the noise of a scanned surface and smooth it away, edges kept (Skin -> Skin)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.repair.skin import Floats, Ints, Skin
from polish_sim.geometry.topology import find_adjacency
from polish_sim.kernel_cache import njit
from polish_sim.spatial import unit

NOISY = 0.01
"""A skin is noisy when its vertices scatter by more than this share of its edges about smooth pieces."""

FEWEST_VERTICES = 500
"""Coarser parts are not looked at: what looks like noise may be their shape."""

NEIGHBOURS = 32, 64, 128
"""Vertices a smooth piece is fitted to: the most about which they scatter no more than about few. The noise left is
about sqrt(6 / neighbours) of what it was."""

_SAMPLE = 2000
_PROBES = 14, 28
_GROWTH = 1.4  # scatter that grows more than this from the smaller to the larger probe is the part's shape
_OUTLIER = 3.0
_SLACK = 1.1
_MISFIT = 1.3  # a vertex stays where it is if the others scatter more than this about its piece: an edge of the part
_SAME_SIDE = np.cos(np.radians(25.0))  # normals further off belong to another side of an edge
_ROUNDS = 2


class Noise(NamedTuple):
    """How a skin scatters."""

    scatter: float
    """Noise of the vertices along their normals, rms [m]."""
    edge: float
    """Median edge [m]."""


def smooth_noise(skin: Skin) -> Skin:
    """Move the vertices of a noisy skin onto smooth pieces fitted to their neighbours.

    Each vertex is moved along its normal onto a quadratic height function fitted to the vertices around it.
    Vertices far from the fit (beyond an edge of the part, outliers) are left out of it step by step.

    Returns:
        The skin, unchanged where it is not noisy; a note of the noise and of how far vertices were moved.
    """
    used = np.unique(skin.faces)
    if len(used) < FEWEST_VERTICES:
        return skin
    noise, edge = measure_noise(skin)
    if noise <= NOISY * edge:
        return skin
    neighbours = _widest(skin, used, noise)
    vertices = skin.vertices
    for _ in range(_ROUNDS):
        moved = vertices.copy()
        moved[used] = _fitted(vertices, used, _vertex_normals(vertices, skin.faces), neighbours, noise, used)[0]
        vertices = moved
    shift = np.linalg.norm(vertices - skin.vertices, axis=1)[used]
    reach = 0.5 * edge * np.sqrt(neighbours)
    note = (
        f"scanned noise of {1e3 * noise:.2g} mm (rms, facet edges {1e3 * edge:.2g} mm): smoothed over about "
        f"{1e3 * reach:.2g} mm, vertices moved by {1e3 * np.sqrt(np.mean(shift**2)):.2g} mm rms, "
        f"at most {1e3 * shift.max():.2g} mm"
    )
    return Skin(vertices, skin.faces, skin.source, (*skin.notes, note))


def measure_noise(skin: Skin) -> Noise:
    """Measure how far vertices scatter about smooth pieces.

    The median over a sample of places of the rms distance of vertices from a quadratic piece through their
    neighbours, so that edges and corners of a part do not count while they are few. Noise is the same about small
    and large pieces; what grows with the piece is the part's shape and is no noise.
    """
    used = np.unique(skin.faces)
    normals = _vertex_normals(skin.vertices, skin.faces)
    small, large = (_scatter(skin, used, normals, probe) for probe in _PROBES)
    edges = skin.vertices[np.roll(skin.faces, -1, axis=1)] - skin.vertices[skin.faces]
    edge = float(np.median(np.linalg.norm(edges, axis=2)))
    return Noise(large if large <= _GROWTH * small else 0.0, edge)


def _scatter(skin: Skin, used: Ints, normals: Floats, neighbours: int) -> float:
    """Median scatter of vertices about pieces fitted to so many neighbours [m]."""
    sample = used[:: max(len(used) // _SAMPLE, 1)]
    return float(np.median(_fitted(skin.vertices, used, normals, neighbours, np.inf, sample)[1]))


def _widest(skin: Skin, used: Ints, noise: float) -> int:
    """The largest number of neighbours one quadratic piece still describes."""
    normals = _vertex_normals(skin.vertices, skin.faces)
    able = [count for count in NEIGHBOURS if _scatter(skin, used, normals, count) <= _SLACK * noise]
    return max(able, default=NEIGHBOURS[0])


def _vertex_normals(vertices: Floats, faces: Ints) -> Floats:
    """Area-weighted unit normals, averaged once more over the facets around, shape (n, 3)."""
    normals, areas = facet_normals(vertices, faces)
    adjacency = find_adjacency(faces)
    for _ in range(2):
        beside = np.where((adjacency.facets >= 0)[..., None], normals[adjacency.facets], 0.0)
        normals = unit(normals + beside.sum(axis=1))
    weighted = areas[:, None] * normals
    total = np.zeros((len(vertices), 3))
    for k in range(3):
        total[:, k] = sum(np.bincount(faces[:, c], weights=weighted[:, k], minlength=len(vertices)) for c in range(3))
    return unit(total)


def _fitted(
    vertices: Floats, used: Ints, normals: Floats, neighbours: int, noise: float, wanted: Ints
) -> tuple[Floats, Floats]:
    """Wanted vertices moved onto their smooth pieces, shape (k, 3), and the scatter about them [m], shape (k,)."""
    tree = cKDTree(vertices[used])
    positions, spread = np.empty((len(wanted), 3)), np.empty(len(wanted))
    for begin in range(0, len(wanted), 20_000):
        part = wanted[begin : begin + 20_000]
        _, near = tree.query(vertices[part], k=min(neighbours, len(used)))
        _fit(vertices, normals, part, used[near], noise, positions[begin:], spread[begin:])
    return positions, spread


@njit(cache=True, error_model="numpy")
def _fit(vertices, normals, wanted, near, noise, positions, spread):  # type: ignore[no-untyped-def]
    """Fit z = c + p x + q y + a x^2 + b x y + d y^2 around each wanted vertex, three times with fewer outliers."""
    rows = np.empty(7)
    around = near.shape[1]
    x, y, z, w = np.empty(around), np.empty(around), np.empty(around), np.empty(around)
    solution = np.empty(6)
    for i in range(len(wanted)):
        here = wanted[i]
        normal = normals[here]
        axis = np.zeros(3)
        axis[np.argmin(np.abs(normal))] = 1.0
        first = np.cross(normal, axis)
        first /= np.sqrt((first * first).sum())
        second = np.cross(normal, first)
        reach = 0.0
        for j in range(around):
            offset = vertices[near[i, j]] - vertices[here]
            x[j], y[j], z[j] = (offset * first).sum(), (offset * second).sum(), (offset * normal).sum()
            reach = max(reach, (offset * offset).sum())
            w[j] = 1.0 if (normals[near[i, j]] * normal).sum() > _SAME_SIDE else 0.0
        reach = np.sqrt(reach) + 1e-300
        scatter = 0.0
        for turn in range(3):
            system = np.zeros((6, 7))
            kept = 0.0
            for j in range(around):
                if w[j] == 0.0:
                    continue
                u, v = x[j] / reach, y[j] / reach
                rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6] = 1.0, u, v, u * u, u * v, v * v, z[j]
                weight = (1.0 - 0.9 * (u * u + v * v)) ** 2
                kept += 1.0
                for a in range(6):
                    for b in range(7):
                        system[a, b] += weight * rows[a] * rows[b]
            solution[:] = 0.0
            if kept < 9.0:
                break
            _solve6(system, solution)
            total = 0.0
            for j in range(around):
                u, v = x[j] / reach, y[j] / reach
                rest = z[j] - (
                    solution[0]
                    + u * (solution[1] + u * solution[3] + v * solution[4])
                    + v * (solution[2] + v * solution[5])
                )
                if w[j] > 0.0:
                    total += rest * rest
                if turn < 2 and abs(rest) > _OUTLIER * noise:
                    w[j] = 0.0
            scatter = np.sqrt(total / max(kept - 6.0, 1.0))
        spread[i] = scatter
        step = solution[0] if scatter <= _MISFIT * noise else 0.0
        for k in range(3):
            positions[i, k] = vertices[here, k] + step * normal[k]


@njit(cache=True, error_model="numpy")
def _solve6(system, out):  # type: ignore[no-untyped-def]
    """Solve symmetric positive equations, shape (6, 7), by Gauss elimination, a little ridge on the diagonal."""
    for i in range(6):
        system[i, i] *= 1.0 + 1e-9
    for i in range(6):
        pivot = system[i, i] + 1e-300
        for j in range(i + 1, 6):
            factor = system[j, i] / pivot
            for k in range(i, 7):
                system[j, k] -= factor * system[i, k]
    for i in range(5, -1, -1):
        total = system[i, 6]
        for k in range(i + 1, 6):
            total -= system[i, k] * out[k]
        out[i] = total / (system[i, i] + 1e-300)
