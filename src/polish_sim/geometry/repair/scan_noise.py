"""Find the noise of a scanned surface and smooth it away, edges kept (Skin -> Skin)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Ints, joined, next_corners, norms, summed, unit
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.jets import tangent_frames
from polish_sim.geometry.repair.skin import ScanNoise, Skin
from polish_sim.geometry.topology import find_adjacency

#: A skin is noisy when its vertices scatter by more than this share of its edges about smooth pieces
NOISY = 0.01
QUIET = 1e-3  #: What scatters by less than this share of the edges is drawn, not scanned
SCANNED_SHARE = 0.2  #: A skin is looked at as scanned where at least this share of it scatters
LONG = 2.0  #: Longest edge of a drawn facet over its shortest
FEWEST_VERTICES = 500  #: Coarser parts are not looked at: what looks like noise may be their shape
NEIGHBOURS = 32, 64, 128
"""Vertices a smooth piece is fitted to: the most about which they scatter no more than about few. The noise
left is about sqrt(6 / neighbours) of what it was."""

#: Noise left of the normals over noise / (reach sqrt(neighbours)): measured on spheres, 4.7 to 5.2
SLOPE_LEFT = 5.0
_SAMPLE = 2000
_PROBES = 14, 28
_GROWTH = 1.4  # scatter that grows more than this from the smaller to the larger probe is the part's shape
_OUTLIER = 3.0
_SLACK = 1.1
# a vertex stays where it is if the others scatter more than this about its piece: an edge of the part
_MISFIT = 1.3
_SAME_SIDE = np.cos(np.radians(25.0))  # normals further off belong to another side of an edge
_ROUNDS = 2
_BATCH = 2000


def smooth_noise(skin: Skin) -> Skin:
    """Move the vertices of a noisy skin onto smooth pieces fitted to their neighbours; a note says how far.

    Each vertex is moved along its normal onto a quadratic height function fitted to the vertices around it.
    Vertices far from the fit (beyond an edge of the part, outliers) are left out of it step by step.
    """
    used = np.unique(skin.faces)
    if len(used) < FEWEST_VERTICES:
        return skin
    lengths = norms(next_corners(skin.vertices[skin.faces]) - skin.vertices[skin.faces])
    edge = np.median(lengths)
    normals = _vertex_normals(skin.vertices, skin.faces)
    few, many = _PROBES
    scatter = _scatter(skin, used, normals, few, QUIET * edge)
    if _GROWTH * scatter <= NOISY * edge or _is_drawn(skin, lengths):
        return skin
    noise = _scatter(skin, used, normals, many, QUIET * edge)
    if not NOISY * edge < noise <= _GROWTH * scatter:
        return skin
    able = [
        count for count in NEIGHBOURS if _scatter(skin, used, normals, count, QUIET * edge) <= _SLACK * noise
    ]
    neighbours = max(able, default=NEIGHBOURS[0])
    vertices = skin.vertices
    for _ in range(_ROUNDS):
        moved = vertices.copy()
        moved[used] = _fitted(vertices, used, _vertex_normals(vertices, skin.faces), neighbours, noise, used)[
            0
        ]
        vertices = moved
    shift = norms(vertices - skin.vertices)[used]
    reach = 0.5 * edge * np.sqrt(neighbours)
    left = ScanNoise(noise * np.sqrt(6.0 / neighbours), SLOPE_LEFT * noise / (reach * np.sqrt(neighbours)))
    note = (
        f"scanned noise of {1e3 * noise:.2g} mm (rms, facet edges {1e3 * edge:.2g} mm): smoothed over about "
        f"{1e3 * reach:.2g} mm, vertices moved by {1e3 * np.sqrt(np.mean(shift**2)):.2g} mm rms, at most "
        f"{1e3 * shift.max():.2g} mm; {1e3 * left.offset:.2g} mm and {np.degrees(left.slope):.2g} deg of the "
        "normals are left of it, within which strokes are smoothed"
    )
    return skin.noted(note, vertices=vertices, noise=left)


def _is_drawn(skin: Skin, lengths: Array) -> bool:
    """Whether most facets are long halves of flat faces, as CAD systems make them and scanners do not."""
    normals, _ = facet_normals(skin.vertices, skin.faces)
    beside = find_adjacency(skin.faces).facets
    flat = (beside >= 0) & (norms(normals[beside] - normals[:, None]) < QUIET)
    return np.mean(flat.any(axis=1) & (lengths.max(axis=1) > LONG * lengths.min(axis=1))) > 0.5


def _scatter(skin: Skin, used: Ints, normals: Array, neighbours: int, quiet: float) -> float:
    """Median over a sample of places of the scatter about pieces fitted to a number of neighbours [m].

    With the median, edges and corners of a part do not count while they are few, nor do places that scatter
    less than ``quiet`` [m], such as the flat base a scan was closed with, while enough others are left.
    """
    sample = used[:: max(len(used) // _SAMPLE, 1)]
    scatter = _fitted(skin.vertices, used, normals, neighbours, np.inf, sample)[1]
    loud = scatter > quiet
    return np.median(scatter[loud] if loud.mean() > SCANNED_SHARE else scatter)


def _vertex_normals(vertices: Array, faces: Ints) -> Array:
    """Area-weighted unit normals, averaged once more over the facets around, shape (n, 3)."""
    normals, areas = facet_normals(vertices, faces)
    adjacency = find_adjacency(faces)
    for _ in range(2):
        beside = np.where((adjacency.facets >= 0)[..., None], normals[adjacency.facets], 0.0)
        normals = unit(normals + beside.sum(axis=1))
    weighted = np.repeat((areas[:, None] * normals)[:, None], 3, axis=1)
    return unit(summed(faces, weighted, len(vertices)))


def _fitted(
    vertices: Array, used: Ints, normals: Array, neighbours: int, noise: float, wanted: Ints
) -> tuple[Array, Array]:
    """Wanted vertices moved onto their smooth pieces, shape (k, 3), and the scatter about them [m], shape
    (k,)."""
    tree = cKDTree(vertices[used])
    fits = []
    for begin in range(0, len(wanted), _BATCH):
        part = wanted[begin : begin + _BATCH]
        _, near = tree.query(vertices[part], k=min(neighbours, len(used)))
        fits.append(_fit(vertices, normals, part, used[near], noise))
    steps, scatter = joined(fits)
    return vertices[wanted] + steps[:, None] * normals[wanted], scatter


def _fit(vertices: Array, normals: Array, wanted: Ints, near: Ints, noise: float) -> tuple[Array, Array]:
    """Fit z = c + p x + q y + a x^2 + b x y + d y^2 around vertices, thrice with fewer outliers: steps,
    scatter [m]."""
    normal = normals[wanted]
    offsets = vertices[near] - vertices[wanted][:, None]
    reach = norms(offsets).max(axis=1) + 1e-300
    u, v = np.einsum("kfj,kaj->fka", tangent_frames(normal) / reach[:, None, None], offsets)
    z = np.einsum("kaj,kj->ka", offsets, normal)
    rows = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v, z], axis=2)
    weights = (1.0 - 0.9 * (u * u + v * v)) ** 2
    kept = np.einsum("kaj,kj->ka", normals[near], normal) > _SAME_SIDE
    scatter = np.zeros(len(wanted))
    for _ in range(3 if np.isfinite(noise) else 1):
        systems = (rows[:, :, :6] * (weights * kept)[..., None]).transpose(0, 2, 1) @ rows
        systems[:, range(6), range(6)] += 1e-9
        enough = kept.sum(axis=1) >= 9
        solution = np.where(enough[:, None, None], np.linalg.solve(systems[:, :, :6], systems[:, :, 6:]), 0.0)
        rest = z - (rows[:, :, :6] @ solution)[..., 0]
        total = (rest**2 * kept).sum(axis=1) / np.maximum(kept.sum(axis=1) - 6.0, 1.0)
        scatter = np.where(enough, np.sqrt(total), scatter)
        kept &= np.abs(rest) <= _OUTLIER * noise
    return np.where(scatter <= _MISFIT * noise, solution[:, 0, 0], 0.0), scatter
