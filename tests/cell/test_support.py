"""Whether a part carries the pad: in the middle of a face it does, near an edge not on a part that lies aside."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from polish_sim.cell import Touch
from polish_sim.cell.real_part import build_part_fields
from polish_sim.cell.support import SINKS, would_sink
from polish_sim.config import PadConfig
from polish_sim.geometry.fit import fit_triangles

PAD = PadConfig(radius_m=0.01)
HALF, DEEPEST = 0.05, 0.008


def sinks(x: float, force: float, aside: float) -> bool:
    """Whether the pad sinks with its middle at ``x`` [m] on a block whose edge is at 50 mm."""
    mesh = trimesh.creation.box((2.0 * HALF, 0.2, 0.02))
    block = fit_triangles(np.array(mesh.vertices) - [0.0, 0.0, 0.01], np.array(mesh.faces, dtype=np.int32))
    place, up = np.array([[x, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    fields = build_part_fields(block, Touch(place, up, PAD.radius_m))
    return bool(would_sink(fields, PAD, place, up, np.array([force]), aside, DEEPEST)[0])


def test_in_the_middle_the_pad_has_a_hold_up_to_the_force_of_its_springs_at_the_depth_there_is() -> None:
    most = PAD.stiffness_n_m * (DEEPEST - SINKS)
    assert not sinks(0.0, 0.99 * most, 0.005)
    assert sinks(0.0, 1.01 * most, 0.0)


@pytest.mark.parametrize("aside", [0.001, 0.003])
def test_what_holds_the_pad_near_an_edge_is_lost_where_the_part_lies_aside_by_as_much_as_it_is_further_in(
    aside: float,
) -> None:
    places = HALF + np.linspace(-0.012, 0.004, 33)
    straight, shifted = ([sinks(x, 20.0, d) for x in places] for d in (0.0, aside))
    last, last_shifted = (places[found.index(True)] for found in (straight, shifted))
    assert not straight[0]
    assert not shifted[0]
    assert straight[-1]
    assert last - last_shifted == pytest.approx(aside, abs=0.8e-3)
