"""From a placed part and its path to a cell ready to run: what every experiment with a part shares (layer 9)."""

from __future__ import annotations

from typing import NamedTuple

from polish_sim.cell import Cell, build_real_part, build_scene
from polish_sim.cell.contact import RealPart
from polish_sim.cell.real_part import depth_for
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.experiments.part_setup import (
    PART_STREAM,
    PAYLOAD_STREAM,
    SENSOR_STREAM,
    polishing_strokes,
    random_streams,
    strongest,
)
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.real_shape import RealShape, touched
from polish_sim.experiments.tool_payload import believe_tool
from polish_sim.geometry import PartMesh, Region, Surface
from polish_sim.planning import ToolPath


class Workplace(NamedTuple):
    """A part as drawn and as it is, the path on it, where it stands and how the arm does it; nothing is random."""

    mesh: PartMesh
    surface: Surface
    region: Region
    path: ToolPath
    reach: Reach
    shape: RealShape


def build_part(scenario: Scenario, place: Workplace) -> RealPart:
    """The part as it really is, displaced and bent as the scenario's seed draws it."""
    touch = touched(place.shape, place.path, scenario.pad.radius_m, modelled_depth(strongest(scenario, place.path)))
    return build_real_part(
        place.shape.surface, scenario.part, place.reach.T_base_work, place.region.surface, place.mesh.up, touch,
        random_streams(scenario.seed)[PART_STREAM],
    )  # fmt: skip


def modelled_depth(scenario: Scenario) -> float:
    """How deep the real part is modelled for a scenario's force and pad [m]."""
    return depth_for(scenario.process.contact_force_n, scenario.pad.stiffness_n_m * scenario.head.spring_scale)


def build_cell(scenario: Scenario, place: Workplace, part: RealPart, hold: float, lift: float) -> Cell:
    """Set the cell up for a path.

    Args:
        scenario: The scenario.
        place: Part, path and reach.
        part: What the pad touches, see ``build_part``.
        hold: Time to stay at the end of a stroke [s].
        lift: Height of the retract [m]; 0 for none.

    Returns:
        The cell, not yet run; its host believes the payload it has calibrated.
    """
    streams = random_streams(scenario.seed)
    cell = Cell(
        strongest(scenario, place.path), build_scene(scenario, place.shape.mesh, part), part,
        polishing_strokes(scenario, place.path, place.reach, hold, lift), place.reach.q_start,
        build_controller(scenario.controller), streams[SENSOR_STREAM],
    )  # fmt: skip
    believe_tool(cell, streams[PAYLOAD_STREAM])
    return cell
