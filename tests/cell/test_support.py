"""Whether a part carries the pad: in the middle of a face it does, near an edge not on a part that lies
aside."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from polish_sim.arrays import Array, Bools
from polish_sim.cell import Touch
from polish_sim.cell.real_part import PartFields, build_part_fields
from polish_sim.cell.support import would_sink
from polish_sim.config import PadConfig
from polish_sim.geometry.fit import fit_triangles

PAD = PadConfig(radius_m=0.01)
HALF, DEEPEST, UP = 0.05, 0.008, np.array([[0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def block() -> PartFields:
    """A block with an edge at x = 50 mm, as the pad meets it near there."""
    mesh = trimesh.creation.box((2.0 * HALF, 0.06, 0.02))
    surface = fit_triangles(np.array(mesh.vertices) - [0.0, 0.0, 0.01], np.array(mesh.faces, dtype=np.int32))
    return build_part_fields(
        surface, Touch(np.array([[0.03, 0.0, 0.0], [0.06, 0.0, 0.0]]), UP[[0, 0]], PAD.radius_m)
    )


def sinks(block: PartFields, x: Array, force: float, aside: float) -> Bools:
    """Whether the pad sinks with its middle at ``x`` (n,) [m]."""
    places = np.column_stack([x, np.zeros((len(x), 2))])
    return would_sink(block, PAD, places, UP.repeat(len(x), axis=0), np.full(len(x), force), aside, DEEPEST)


def test_near_an_edge_the_hold_is_lost_the_earlier_the_further_aside_the_part_may_lie(
    block: PartFields,
) -> None:
    """Inside it lasts up to the force of the pad's springs at the depth there is."""
    most, inside = PAD.stiffness_n_m * DEEPEST, np.array([0.03])
    assert not sinks(block, inside, 0.99 * most, 0.001).any()
    assert sinks(block, inside, 1.01 * most, 0.0).all()
    x = np.arange(0.03, 0.06, 0.00025)
    lost = [sinks(block, x, 20.0, aside) for aside in (0.0, 0.003, 0.005)]
    for found in lost:
        assert 0 < np.count_nonzero(found) < len(x)
    straight, shifted, further = (x[found.argmax()] for found in lost)
    assert straight > HALF  # with its middle on the edge a half of the pad is left, and enough
    assert straight - shifted > 0.001
    assert shifted - further > 0.001
