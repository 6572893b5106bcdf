"""From a placed part and its path to a cell ready to run: what every experiment with a part shares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from polish_sim.calibration import read_calibrated_tool
from polish_sim.cell import Cell, Stroke, build_course, build_real_part, build_scene, parse_events
from polish_sim.cell.faults import check_events
from polish_sim.cell.limits import check_contact_settings, check_rates
from polish_sim.cell.real_arm import is_real
from polish_sim.cell.real_part import PartFields, Touch, build_fixture, build_part_fields, depth_for
from polish_sim.cell.scene import Drawn, works_below
from polish_sim.control import Controller, Course, build_controller
from polish_sim.errors import InputError
from polish_sim.experiments.part_setup import (
    PART_STREAM,
    PAYLOAD_STREAM,
    SENSOR_STREAM,
    RealShape,
    largest_force,
    polishing_strokes,
    random_streams,
    touched,
)
from polish_sim.experiments.payload import believe_tool
from polish_sim.experiments.stroke_motion import within_noise
from polish_sim.models import part_path
from polish_sim.planning.request import check_asked, check_part_words

if TYPE_CHECKING:
    from polish_sim.cell.contact import RealPart
    from polish_sim.config import Scenario
    from polish_sim.experiments.placement import Reach
    from polish_sim.geometry import PartMesh, Region, Surface
    from polish_sim.geometry.fixture import Fixture
    from polish_sim.planning import ToolPath


@dataclass(frozen=True)
class Workplace:
    """A part as drawn and as it is, the path on it, where it stands and how the arm does it; nothing is random."""

    mesh: PartMesh
    surface: Surface
    region: Region
    path: ToolPath
    reach: Reach
    shape: RealShape
    fixture: Fixture | None = None
    _kept: dict[tuple[bool, float, float], PartFields] = field(default_factory=dict, init=False, repr=False)

    def drawn(self, scenario: Scenario) -> PartFields:
        """Distances of the nominal part where a scenario's pad goes; sampled at first use and kept."""
        return self._fields(RealShape(self.mesh, self.surface, given=False), scenario)

    def actual(self, scenario: Scenario) -> PartFields:
        """Distances of the part as it is, before it is displaced and bent; sampled at first use and kept."""
        return self._fields(self.shape, scenario)

    def _fields(self, shape: RealShape, scenario: Scenario) -> PartFields:
        depth = modelled_depth(scenario, largest_force(scenario, self.path))
        key = (shape.given, scenario.pad.radius_m, depth)
        if key not in self._kept:
            self._kept[key] = build_part_fields(shape.surface, touched(shape, self.path, scenario.pad.radius_m, depth))
        return self._kept[key]


def build_part(scenario: Scenario, place: Workplace) -> RealPart:
    """The part as it really is, displaced and bent as the scenario's seed draws it."""
    return build_real_part(
        place.actual(scenario), scenario.part, place.reach.T_base_work, place.region.surface, place.mesh.up,
        random_streams(scenario.seed)[PART_STREAM],
    )  # fmt: skip


def modelled_depth(scenario: Scenario, force: float) -> float:
    """How deep the real part is modelled for a force [N] on a scenario's pad [m]."""
    return depth_for(force, scenario.pad.stiffness_n_m * scenario.head.spring_scale)


def build_cell(scenario: Scenario, place: Workplace, part: RealPart, hold: float, lift: float) -> Cell:
    """Set the cell up for a path on a part of ``build_part``, not yet run; its host believes its calibrated payload.

    The tool stays ``hold`` [s] at the end of a stroke and is lifted by ``lift`` [m]; 0 for no retract.
    """
    streams = random_streams(scenario.seed)
    strokes = polishing_strokes(within_noise(scenario, place.mesh.noise), place.path, place.reach, hold, lift)
    controller = build_controller(scenario.controller)
    held_behind, fixture = works_below(place.reach.T_base_work, place.path.axes_work), standing_fixture(scenario, place)
    cell = Cell(
        scenario, build_scene(scenario, place.shape.mesh, part, held_behind, fixture), part, strokes,
        place.reach.q_start, controller, streams[SENSOR_STREAM], course_for(controller, scenario, place, strokes),
        None if fixture is None else fixture.part,
    )  # fmt: skip
    believe_tool(cell, streams[PAYLOAD_STREAM])
    return cell


def standing_fixture(scenario: Scenario, place: Workplace) -> Drawn | None:
    """What holds the part, before the robot; it stands as drawn, however the part lies in it."""
    if place.fixture is None:
        return None
    way = Touch(place.path.positions_work, place.path.axes_work, scenario.pad.radius_m)
    return Drawn(place.fixture.mesh, build_fixture(place.fixture.surface, way, place.reach.T_base_work))


def course_for(
    controller: Controller, scenario: Scenario, place: Workplace, strokes: Sequence[Stroke]
) -> Course | None:
    """What lies ahead on the path, for a controller that prepares for it; None for the others."""
    if not callable(getattr(controller, "prepare", None)):
        return None
    return build_course(scenario, strokes, place.drawn(scenario).near, place.reach.T_base_work)


# Settings that are wrong for any part are refused before anything is loaded, planned or simulated.

CONTROLLED: Final = ("arc", "force", "surface", "dual")  #: Experiments in which a controller drives the cell
ON_PART: Final = ("force", "surface", "dual")  #: Those with a part to press on


def check_settings(scenario: Scenario, plans: bool) -> None:
    """Refuse a scenario that could not be run on any part, or whose path could not be planned on any (``plans``).

    Raises:
        PolishSimError: Naming what is wrong and what to do.
    """
    if scenario.payload.file:
        read_calibrated_tool(Path(scenario.payload.file))
    events = parse_events(scenario.faults.events)
    is_real(scenario)
    if scenario.part.fixture_file and scenario.experiment != "surface":
        raise InputError(f"part.fixture_file is for 'plan' and 'run surface': leave it out of '{scenario.experiment}'.")
    if scenario.experiment not in CONTROLLED:
        return
    if scenario.experiment in ON_PART:
        if plans:
            check_asked(scenario.part, scenario.plan, scenario.pad)
        else:
            check_part_words(scenario.part, scenario.plan)
        _check_file(scenario.part.real_file, "real part", "--real-part")
        _check_file(scenario.part.fixture_file, "fixture", "--fixture")
    check_rates(scenario)
    check_events(events, scenario.experiment in ON_PART, two_robots=scenario.experiment == "dual")
    build_controller(scenario.controller)


def check_force(scenario: Scenario, path: ToolPath | None) -> None:
    """Refuse a force that pad, head and guards cannot bear; a ``path`` made before may say its own forces.

    Raises:
        ConfigError: Naming the limit that is broken.
    """
    if scenario.experiment in CONTROLLED:
        force = scenario.process.contact_force_n if path is None else largest_force(scenario, path)
        check_contact_settings(scenario, force)


def _check_file(name: str, what: str, option: str) -> None:
    if name and not part_path(name).is_file():
        raise InputError(f"the {what} '{name}' is no file. Check the name and the folder ({option}).")
