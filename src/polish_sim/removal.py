"""What a run took off the part: Preston's integral at every node of the region, in npz (layer 3).

Preston's law says dh/dt = k_p p v. The exposure, the integral of p v dt [N/m], is what the cell knows; the depth taken
off is the wear coefficient k_p [1/Pa] times it. Without a coefficient the removal is relative: exposure over its mean.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RemovalMap:
    """Exposure over the region, on the fine triangles of its drawing."""

    vertices: Array
    """Nodes on the nominal surface, work frame [m], shape (n, 3)."""
    normals: Array
    """Unit outward normals there, shape (n, 3)."""
    triangles: NDArray[np.int64]
    """Vertex indices, shape (m, 3)."""
    areas: Array
    """Area each node stands for [m^2], shape (n,); their sum is the region's."""
    exposure: Array
    """Integral of pressure x sliding speed over time [N/m], shape (n,)."""
    up: Array
    """Where the region is looked at from, unit, shape (3,)."""
    preston_1_pa: float
    """Wear coefficient [1/Pa]; 0: unknown, the removal is relative."""
    elsewhere_nm: float
    """Exposure summed over the surfaces beside the region that the pad came to as well [N m]."""
    unplaced_share: float
    """Share of the force's impulse for which the pad touched no node [-]."""
    field_ratio: float
    """Impulse of the pressure field before it is scaled to the exact force, over that of the exact force [-]."""

    @cached_property
    def mean(self) -> float:
        """Mean exposure over the region's area [N/m]."""
        return float(self.areas @ self.exposure) / float(self.areas.sum())

    @property
    def absolute(self) -> bool:
        """Whether a wear coefficient makes the removal a depth in metres."""
        return self.preston_1_pa > 0.0

    @cached_property
    def relative(self) -> Array:
        """Removal over its mean [-], shape (n,); zero where nothing was removed at all."""
        return self.exposure / self.mean if self.mean > 0.0 else np.zeros_like(self.exposure)

    @cached_property
    def border(self) -> NDArray[np.int64]:
        """Ends of the edges with one triangle only, shape (b, 2)."""
        edges = np.sort(
            np.concatenate([self.triangles[:, [0, 1]], self.triangles[:, [1, 2]], self.triangles[:, [2, 0]]])
        )
        found, count = np.unique(edges, axis=0, return_counts=True)
        return found[count == 1]


def write_removal(file: Path, removal: RemovalMap) -> None:
    """Write the map as a compressed npz without pickle, positions and exposure in single precision."""
    single = {"vertices", "normals", "areas", "exposure"}
    columns = {
        name: np.asarray(value, dtype=np.float32) if name in single else value
        for name, value in vars(removal).items()
        if name in RemovalMap.__dataclass_fields__
    }
    columns["triangles"] = removal.triangles.astype(np.int32)
    temporary = file.with_name(f".{file.name}.part")
    with temporary.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **columns)
    temporary.replace(file)


def read_removal(file: Path) -> RemovalMap:
    """Read a map written by ``write_removal``.

    Raises:
        InputError: If the file is damaged or lacks an entry.
    """
    try:
        with np.load(file, allow_pickle=False) as archive:
            found = {name: archive[name].astype(np.float64) for name in archive.files}
        columns = {name: value if value.ndim else float(value) for name, value in found.items()}
        return RemovalMap(**(columns | {"triangles": found["triangles"].astype(np.int64)}))  # type: ignore[arg-type]
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"cannot read the removal map '{file}': {error}. Delete it to see the run without.") from error
