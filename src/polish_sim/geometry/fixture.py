"""What holds the part: a mesh in the part's own frame, read as a part is, which the tool must keep clear
of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.geometry.fit import fit_surface
from polish_sim.geometry.mesh import PartMesh, load_part
from polish_sim.geometry.surface import Surface, join_surfaces


class Fixture(NamedTuple):
    """A fixture, in the work frame of the part it holds."""

    mesh: PartMesh
    surface: Surface

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or repaired, for the user; which side is up is the part's affair."""
        return tuple(f"fixture: {note}" for note in self.mesh.notes[:-1])


def load_fixture(file: str, part: PartMesh) -> Fixture | None:
    """Load the fixture of a part, in the part's unit; None without a ``file``.

    Raises:
        MeshError: The file is no usable mesh; the message says why and what to do.
    """
    if not file:
        return None
    mesh = load_part(Path(file), part.unit, "z")
    return Fixture(mesh, fit_surface(mesh))


def joined_meshes(part: PartMesh, fixture: Fixture | None) -> PartMesh:
    """A part and its fixture as one mesh; the part's name and notes."""
    if fixture is None:
        return part
    own = fixture.mesh
    return replace(
        part,
        vertices=np.concatenate([part.vertices, own.vertices]),
        faces=np.concatenate([part.faces, own.faces + len(part.vertices)]).astype(np.int32),
        stl_facets=np.concatenate([part.stl_facets, np.full_like(own.stl_facets, -1)]),
    )


def joined_surfaces(part: Surface, fixture: Fixture | None) -> Surface:
    """A part and its fixture as one surface, the part's facets first."""
    return part if fixture is None else join_surfaces([part, fixture.surface])
