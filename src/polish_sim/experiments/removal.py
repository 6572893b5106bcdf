"""What a run of ``surface`` or ``dual`` took off the part, by Preston's law (layer 9)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell import CellRun, RealPart
from polish_sim.cell.pad_motion import PadMotion, pad_motion
from polish_sim.cell.pressed_nodes import place_nodes
from polish_sim.cell.removal import Removed, expose_nodes
from polish_sim.config import Scenario
from polish_sim.experiments.assembly import Workplace
from polish_sim.experiments.real_shape import touched
from polish_sim.log import RunLog, with_column
from polish_sim.removal import RemovalMap

Array = NDArray[np.float64]


class Removal(NamedTuple):
    """A run's removal, over the region and over time."""

    map: RemovalMap
    log: RunLog
    """The run's log with the running exposure of the whole part."""


def remove_material(
    scenario: Scenario, place: Workplace, part: RealPart, run: CellRun, part_turns: Array | None = None
) -> Removal:
    """Sum Preston's law up over a finished run; the loop is not slowed down by it.

    Args:
        scenario: Pad and wear coefficient.
        place: The nominal part, its region and the path.
        part: The part the pad met.
        run: The run.
        part_turns: How a part that is carried stands in the base at the log's rows, shape (n, 3, 3).

    Returns:
        The map and the log.
    """
    pad, head = scenario.pad, scenario.head
    nodes = place_nodes(
        place.surface, place.region, part, touched(place.shape, place.path, pad.radius_m, part.field.band)
    )
    motion = pad_motion(run.log, run.trace, part, pad.radius_m, part_turns)
    removed = expose_nodes(nodes.pressed, motion, pad.radius_m, pad.stiffness_n_m * head.spring_scale)
    own = len(nodes.mesh.vertices)
    pressed = float(motion.impulses.sum())
    removal = RemovalMap(
        vertices=nodes.mesh.vertices,
        normals=nodes.mesh.normals,
        triangles=nodes.mesh.triangles,
        areas=nodes.pressed.areas[:own],
        exposure=removed.exposure[:own],
        up=place.region.up,
        preston_1_pa=scenario.process.preston_1_pa,
        elsewhere_nm=float(nodes.pressed.areas[own:] @ removed.exposure[own:]),
        unplaced_share=float(motion.impulses[removed.carried <= 0.0].sum()) / pressed if pressed > 0.0 else math.nan,
        field_ratio=float(removed.carried @ motion.times) / pressed if pressed > 0.0 else math.nan,
    )
    return Removal(removal, with_column(run.log, "exposure_nm", _running(run.log, motion, removed)))


def _running(log: RunLog, motion: PadMotion, removed: Removed) -> Array:
    """Exposure summed over the part up to each row of the log [N m], shape (n,)."""
    rows = np.asarray(log["time_s"], dtype=np.float64)
    if not len(motion.times):
        return np.zeros(len(rows))
    # Between steps in contact nothing is gained.
    moments = np.stack([motion.ends_s - motion.times, motion.ends_s], axis=1).ravel()
    total = np.cumsum(removed.gained)
    return np.interp(rows, moments, np.stack([total - removed.gained, total], axis=1).ravel())
