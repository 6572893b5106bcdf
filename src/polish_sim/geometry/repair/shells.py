"""The closed and open pieces a skin consists of: turned outward, counted, measured (Skin -> Skin, notes)."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

from polish_sim.errors import MeshError
from polish_sim.geometry.repair.skin import Floats, Ints, Skin
from polish_sim.geometry.repair.winding import wind_consistently
from polish_sim.geometry.topology import facet_links, find_adjacency, label_pieces

_SHOWN = 6
_MOST_NESTED = 2000  # with more closed pieces than this none is taken for a hollow


class Shells(NamedTuple):
    """Connected pieces of a skin."""

    labels: Ints
    """Piece of each facet, shape (m,)."""
    closed: Ints
    """1 where a piece has no border, shape (k,)."""
    volumes: Floats
    """Volume a closed piece encloses, negative where its facets look inward; 0 for open ones [m^3], shape (k,)."""
    low: Floats
    """Lower corners of their bounding boxes [m], shape (k, 3)."""
    high: Floats
    """Upper corners, shape (k, 3)."""


def wind_alike(skin: Skin, path: Path) -> Skin:
    """Wind the facets of every piece alike; the majority of a piece stays as it is.

    Raises:
        MeshError: The surface has only one side (a Moebius strip), so no winding is right.
    """
    wound, flips, two_sided = wind_consistently(skin.faces)
    if not two_sided:
        raise MeshError(f"{path}: the surface is one-sided (like a Moebius strip). Repair the part.")
    if not flips:
        return skin
    note = f"turned {flips} facets that were wound the other way"
    return Skin(skin.vertices, wound, skin.source, (*skin.notes, note))


def turn_outward(skin: Skin) -> Skin:
    """Let closed pieces look outward, and those within others (hollows) inward; open pieces stay."""
    shells = find_shells(skin)
    depth = _depths(skin.vertices, skin.faces, shells)
    wrong = (shells.closed == 1) & ((shells.volumes < 0.0) != (depth % 2 == 1))
    if not wrong.any():
        return skin
    faces = np.where(wrong[shells.labels][:, None], skin.faces[:, ::-1], skin.faces)
    what = "the whole part inside out: its" if len(wrong) == 1 else f"{wrong.sum()} of {len(wrong)} bodies: their"
    notes = (*skin.notes, f"turned {what} normals pointed inward")
    return Skin(skin.vertices, np.ascontiguousarray(faces), skin.source, notes)


def find_shells(skin: Skin) -> Shells:
    """Label connected pieces and measure them."""
    adjacency = find_adjacency(skin.faces)
    count, labels = label_pieces(facet_links(adjacency), len(skin.faces))
    closed = np.ones(count, dtype=np.int32)
    closed[labels[(adjacency.facets < 0).any(axis=1)]] = 0
    corners = skin.vertices[skin.faces]
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, labels, corners.min(axis=1))
    np.maximum.at(high, labels, corners.max(axis=1))
    centred = corners - 0.5 * (low + high)[labels][:, None, :]
    sixfold = np.einsum("mj,mj->m", centred[:, 0], np.cross(centred[:, 1], centred[:, 2]))
    volumes = np.where(closed == 1, np.bincount(labels, weights=sixfold, minlength=count) / 6.0, 0.0)
    return Shells(labels, closed, volumes, low, high)


def describe_shells(skin: Skin) -> tuple[str, ...]:
    """Notes on a part of several bodies: how many, how large, how many hollows."""
    shells = find_shells(skin)
    if len(shells.closed) == 1:
        return ()
    hollow = shells.volumes < 0.0
    notes = []
    if hollow.any():
        notes.append(f"hollow inside: {_count(int(hollow.sum()), 'closed shell')} within others")
    sizes = 1e3 * (shells.high - shells.low)[~hollow]
    if len(sizes) > 1:
        sizes = sizes[np.argsort(-sizes.max(axis=1), kind="stable")]
        shown = "; ".join(" x ".join(f"{length:.4g}" for length in size) for size in sizes[:_SHOWN])
        more = f"; and {len(sizes) - _SHOWN} more" if len(sizes) > _SHOWN else ""
        notes.append(
            f"{len(sizes)} bodies in one file ({int(shells.closed[~hollow].sum())} of them closed), "
            f"of {shown}{more} mm: all are kept; the path lies on the one its region belongs to"
        )
    return tuple(notes)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' if number != 1 else ''}"


def _depths(vertices: Floats, faces: Ints, shells: Shells) -> Ints:
    """In how many other closed pieces each closed piece lies, shape (k,)."""
    depth = np.zeros(len(shells.closed), dtype=np.int32)
    closed = np.flatnonzero(shells.closed)
    if not 2 <= len(closed) <= _MOST_NESTED:
        return depth
    order = np.argsort(shells.labels, kind="stable")
    first = np.searchsorted(shells.labels[order], np.arange(len(depth) + 1))
    for inner in closed:
        around = (shells.low[closed] <= shells.low[inner]).all(axis=1)
        around &= (shells.high[closed] >= shells.high[inner]).all(axis=1)
        point = vertices[faces[order[first[inner]]]].mean(axis=0)
        for outer in closed[around]:
            if outer != inner:
                members = order[first[outer] : first[outer + 1]]
                depth[inner] += abs(_turns_around(point, vertices, faces, members)) > 0.5
    return depth


@njit(cache=True, error_model="numpy")
def _turns_around(point, vertices, faces, members):  # type: ignore[no-untyped-def]
    """Winding number of a closed piece about a point (van Oosterom and Strackee's solid angles)."""
    total = 0.0
    for facet in members:
        a, b, c = (
            vertices[faces[facet, 0]] - point,
            vertices[faces[facet, 1]] - point,
            vertices[faces[facet, 2]] - point,
        )
        la, lb, lc = np.sqrt((a * a).sum()), np.sqrt((b * b).sum()), np.sqrt((c * c).sum())
        triple = (
            a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
        below = la * lb * lc + (a * b).sum() * lc + (b * c).sum() * la + (c * a).sum() * lb
        total += 2.0 * np.arctan2(triple, below)
    return total / (4.0 * np.pi)
