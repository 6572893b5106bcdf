"""A region seen from where it looks: its narrowest width is that of the part, whatever way the part is turned."""

from __future__ import annotations

import pytest
import trimesh
from scipy.spatial.transform import Rotation

from polish_sim.geometry import fit_surface, part_from_arrays, select_region
from polish_sim.planning.ground.ground import footprint


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_top_of_a_box_is_as_wide_as_its_short_side(seed):
    turn = Rotation.random(random_state=seed)
    box = trimesh.creation.box((0.2, 0.12, 0.05))
    up = ",".join(str(value) for value in turn.apply([0.0, 0.0, 1.0]))
    mesh = part_from_arrays(turn.apply(box.vertices), box.faces, up=up)
    seen = footprint(select_region(fit_surface(mesh), mesh, "top"))
    assert seen.widths.min() == pytest.approx(0.12, abs=1e-12)
    narrowest = seen.frame @ seen.ways[int(seen.widths.argmin())]
    assert abs(narrowest @ turn.apply([0.0, 1.0, 0.0])) == pytest.approx(1.0)
