"""From a placed part and its path to a cell ready to run: what every experiment with a part shares."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Hashable, Sequence
from dataclasses import asdict, dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from polish_sim.calibration import read_calibrated_tool
from polish_sim.cell import Cell, Stroke, build_course, build_real_part, build_scene
from polish_sim.cell.cell import NO_LESSON
from polish_sim.cell.contact import RealPart
from polish_sim.cell.faults import changed_force, check_events
from polish_sim.cell.limits import check_contact_settings, check_rates, modelled_depth
from polish_sim.cell.real_arm import take_arm
from polish_sim.cell.real_part import PartFields, Touch, build_fixture, build_part_fields
from polish_sim.cell.scene import Drawn
from polish_sim.config import Checked, PartConfig, Scenario
from polish_sim.control import Controller, Course, build_controller
from polish_sim.errors import ConfigError, InputError, near_file
from polish_sim.experiments.beliefs import (
    believe_tool,
    believed_arm,
    check_compensation,
    check_learning,
    read_lesson,
)
from polish_sim.experiments.part_setup import (
    RealShape,
    placed_strokes,
    placed_tool,
    random_streams,
    touched,
)
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.registry import check_flange, experiment, known_faults, load
from polish_sim.experiments.stroke_motion import check_stroke_rule, within_noise
from polish_sim.geometry import PartMesh, Region, Surface
from polish_sim.geometry.fit import Fixture
from polish_sim.geometry.regions.region import check_part_words
from polish_sim.models import part_path
from polish_sim.motion import use_arm
from polish_sim.planning import ToolPath
from polish_sim.scenario_file import FILE_KEYS, check_words
from polish_sim.source_stamp import short_hash


@dataclass(frozen=True, eq=False)
class Workplace:
    """A part as drawn and as it is, the path on it, where it stands and how the arm does it; nothing is
    random."""

    mesh: PartMesh
    surface: Surface
    region: Region
    path: ToolPath
    reach: Reach
    shape: RealShape
    fixture: Fixture | None = None
    holds: bool = False  #: Whether the tool stays on one point
    held: str = ""  #: How a second robot holds the part, for the user
    _kept: dict[tuple[bool, float, float], PartFields] = field(default_factory=dict, init=False, repr=False)

    @property
    def drawn(self) -> RealShape:
        """The part as drawn."""
        return RealShape(self.mesh, self.surface, given=False)

    def along(self, path: ToolPath, reach: Reach) -> Workplace:
        """The place under a path that goes nowhere else, with the distances that were sampled."""
        place = replace(self, path=path, reach=reach)
        place._kept.update(self._kept)
        return place

    def fields(self, shape: RealShape, scenario: Checked) -> PartFields:
        """Distances of the part as ``drawn``, or as it is before it is displaced and bent (``shape``), where
        a scenario's pad goes; sampled at first use and kept."""
        process, pad = scenario.process, scenario.pad
        force = self.path.largest_force(process.contact_force_n)
        depth = modelled_depth(process, force, pad.stiffness_n_m * scenario.head.spring_scale)
        key = (shape.given, pad.radius_m, depth)
        if key not in self._kept:
            self._kept[key] = build_part_fields(shape.surface, touched(shape, self.path, pad.radius_m, depth))
        return self._kept[key]


def build_part(scenario: Checked, place: Workplace) -> RealPart:
    """The part as it really is, displaced and bent as the scenario's seed draws it; kept for the next run
    with it."""
    part = scenario.part
    fields = place.fields(place.shape, scenario)
    drawn = part.displacement_m, part.rotation_rad, part.form_error_m, scenario.seed
    return PARTS.get(
        (drawn, place, fields),
        lambda: build_real_part(
            fields, part, place.reach.T_base_work, place.region.surface, place.mesh.up,
            random_streams(scenario.seed).part,
        ),
    )  # fmt: skip


# What is not random (plan, placement) and what only the seed decides (the real part) is kept between runs of
# a process: a freeform part's distance field takes longer than polishing it.

T = TypeVar("T")
_KEPT: Final = 3  #: Places and parts a process remembers; a freeform part takes tens of megabytes


class Memory:
    """The last few things made, by key."""

    def __init__(self) -> None:
        self._made: dict[Hashable, Any] = {}

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """What was made for a key before, or made now."""
        made: T = self._made.pop(key) if key in self._made else make()
        self._made[key] = made
        while len(self._made) > _KEPT:
            self._made.pop(next(iter(self._made)))
        return made


PLACES, PARTS = Memory(), Memory()


def kept_place(scenario: Scenario, make: Callable[[], T], *made_for: Hashable) -> T:
    """What `make` finds for the plan and the reach of a scenario, or found before; the process computes with
    the scenario's arm from here on."""
    use_arm(scenario.robot.arm)
    return PLACES.get((place_key(scenario), *made_for), make)


def place_key(scenario: Scenario) -> Hashable:
    """What plan and reach depend on, with the files' dates; approach and what a seed draws do not change
    them, the feed changes an even removal alone."""
    part = replace(
        scenario.part, displacement_m=0.0, rotation_rad=0.0, form_error_m=0.0, motion_m=0.0, motion_hz=0.0
    )  # fmt: skip
    files = [
        *part_files(part), Path(scenario.plan.region.partition(":")[2]), Path(scenario.plan.removal)
    ]  # fmt: skip
    dates = tuple((file.stat().st_mtime_ns, file.stat().st_size) for file in files if file.is_file())
    head, safety = scenario.head, scenario.safety
    settings = (
        scenario.robot.arm, scenario.smoothing.rule, scenario.process.contact_force_n, head.stiffness_n_m,
        head.travel_m, head.flange, safety.singular_value_limit, safety.tool_in_part,
    )  # fmt: skip
    dwell = scenario.plan.removal and (scenario.process, head, scenario.spindle, safety)
    return scenario.experiment, part, scenario.plan, scenario.pad, settings, dates, dwell


def user_files(scenario: Scenario) -> list[Path]:
    """Files a scenario names, of its controller first."""
    words = [
        scenario.controller.name.rpartition(":")[0],
        scenario.plan.region.partition(":")[2],
        scenario.plan.file,
    ]
    words += [attrgetter(key)(scenario) for key in FILE_KEYS if not key.startswith("part.")]
    return list(filter(Path.is_file, (*map(Path, words), *part_files(scenario.part))))


def part_files(part: PartConfig) -> list[Path]:
    """Files of a part, of the part as it is and of what holds it, whether they are there or not."""
    return [part_path(name) for name in (part.file, part.real_file, part.fixture_file) if name]


def config_hash(scenario: Scenario, hashes: dict[Path, str]) -> str:
    """What identifies a run: its full config, with the contents of the files it names (kept in
    ``hashes``)."""
    files = user_files(scenario)
    for file in files:
        if file not in hashes:
            hashes[file] = hashlib.sha256(file.read_bytes()).hexdigest()
    text = json.dumps(asdict(scenario), sort_keys=True)
    for file in files:
        # A file moved elsewhere is still the same.
        text = text.replace(json.dumps(str(file))[1:-1], f"{file.name}#{hashes[file]}")
    return short_hash(text.encode())


def strokes_for(scenario: Checked, place: Workplace) -> list[Stroke]:
    """The strokes of a cell on the nominal part; the tool holds at the end of the last one, or it is
    lifted."""
    use_arm(scenario.robot.arm)
    hold, lift = (scenario.process.hold_s, 0.0) if place.holds else (0.0, scenario.plan.clearance_m)
    scenario = replace(scenario, smoothing=within_noise(scenario.smoothing, place.mesh.noise))
    return placed_strokes(scenario, place.path, placed_tool(place.path, place.reach), hold, lift)


def build_cell(
    scenario: Checked, place: Workplace, part: RealPart | None = None, strokes: Sequence[Stroke] = ()
) -> Cell:
    """Set the cell up for a path, not yet run, on its ``build_part`` and with its ``strokes_for`` unless they
    were made before; its host believes its calibrated payload."""
    part = part or build_part(scenario, place)
    strokes = strokes or strokes_for(scenario, place)
    streams = random_streams(scenario.seed)
    controller = build_controller(scenario.controller)
    lesson = NO_LESSON
    if scenario.process.learn:
        lesson = read_lesson(scenario, place.path, place.reach)
        # The part lies and the arm errs as before, the sensor's noise is another.
        again = np.random.SeedSequence(scenario.seed).spawn(len(streams) + lesson.runs)[-1]
        streams = streams._replace(sensor=np.random.default_rng(again))
    fixture = standing_fixture(scenario.pad.radius_m, place)
    cell = Cell(
        scenario,
        build_scene(scenario, Drawn(place.shape.mesh, part), place.path.axes_work, fixture),
        part,
        strokes,
        place.reach.q_start,
        controller,
        streams.sensor,
        course_for(controller, scenario, place, strokes),
        fixture and fixture.part,
        lesson,
        believed_arm(scenario, place.reach.q_start),
    )
    believe_tool(cell, streams.payload)
    return cell


def standing_fixture(pad_radius: float, place: Workplace) -> Drawn | None:
    """What holds the part, before the robot; it stands as drawn, however the part lies in it."""
    if not place.fixture:
        return None
    way = Touch(place.path.positions_work, place.path.axes_work, pad_radius)
    return Drawn(place.fixture.mesh, build_fixture(place.fixture.surface, way, place.reach.T_base_work))


def course_for(
    controller: Controller, scenario: Checked, place: Workplace, strokes: Sequence[Stroke]
) -> Course | None:
    """What lies ahead on the path, for a controller that prepares for it; None for the others."""
    if not callable(getattr(controller, "prepare", None)):
        return None
    near = place.fields(place.drawn, scenario).near
    reach = place.reach
    return build_course(scenario, strokes, near, reach.T_base_work, reach.q_start)


# Settings that are wrong for any part are refused before anything is loaded, planned or simulated.

PROOFS = ("none", "nominal")
MOST_SEEDS = 1000


def proof_seeds(word: str) -> int:
    """How many drawn parts a plan is proven on besides the part as drawn, by ``safety.proof``.

    Raises:
        InputError: It is neither none, nominal nor a count.
    """
    if word in PROOFS:
        return 0
    if not word.isdecimal() or not 1 <= int(word) <= MOST_SEEDS:
        raise InputError(
            f"--proof '{word}' is not known: give none, nominal, or the number of drawn parts, 1 to "
            f"{MOST_SEEDS}."
        )
    return int(word)


def check_settings(scenario: Scenario) -> None:
    """Refuse a scenario that could not be run on any part, or whose path could not be planned on any.

    Raises:
        PolishSimError: Naming what is wrong and what to do.
    """
    if scenario.payload.file:
        read_calibrated_tool(Path(scenario.payload.file))
    check_words(scenario)
    take_arm(scenario.robot)
    proof_seeds(scenario.safety.proof)
    row = experiment(scenario.experiment)
    faults = scenario.faults.events
    check_events(faults, scenario.process, row.on_part, load(row.faults), known_faults())
    check_flange(scenario)
    check_compensation(scenario.robot, scenario.seed, row)
    if row.check:
        load(row.check)(scenario)
    if scenario.process.learn and not row.plans:
        raise InputError(f"process.learn is for 'run surface': leave it out of '{scenario.experiment}'.")
    if scenario.part.fixture_file and not row.plans:
        raise InputError(
            f"part.fixture_file is for 'plan' and 'run surface': leave it out of '{scenario.experiment}'."
        )
    check_stroke_rule(scenario.smoothing)
    controller = build_controller(scenario.controller)
    if not row.controlled:
        return
    if row.on_part:
        if row.plans and not scenario.plan.file:
            from polish_sim.planning.feasibility import check_asked  # slow to import

            check_asked(scenario.part, scenario.plan, scenario.pad)
        else:
            check_part_words(scenario.part, scenario.plan)
        removal = scenario.plan.removal
        maps = [Path(removal)] if removal not in ("", "even") else []
        for file in part_files(scenario.part) + maps:
            if not file.exists():
                raise InputError(f"'{file}' is no file. Check name and folder.{near_file(file)}")
    check_rates(scenario)
    if scenario.process.learn:
        check_learning(scenario.process.learn, scenario.controller.label, controller)


def check(scenario: Scenario, path: ToolPath | None = None) -> Checked:
    """`check_settings`, and refuse a force that pad, head and guards cannot bear; a ``path`` made before may
    say its own forces.

    An even removal needs sliding beside the feed's, else the way alone decides what comes off. For it the
    tool keeps its planned axis: where the pad hangs over an edge the moment loop would turn the tool by up to
    2 deg, and the map with it.
    """
    check_settings(scenario)
    if experiment(scenario.experiment).controlled:
        usual = scenario.process.contact_force_n
        force = usual if path is None else path.largest_force(usual)
        check_contact_settings(scenario, changed_force(scenario.process, force))
    asked = scenario.plan
    if asked.removal:
        if not 0.0 < asked.removal_feed[0] < asked.removal_feed[1]:
            raise ConfigError(
                "plan.removal_feed must be the least and the largest share of the feed, in this order."
            )
        if scenario.dual.standoff_m > 0.0 and path is None:
            raise ConfigError(
                "at a stand-off (dual.standoff_m, --standoff) nothing comes off: leave it or plan.removal "
                "out."
            )
        if not scenario.spindle.speed_rpm + scenario.pad.slide_m_s:
            raise InputError(
                "a removal to order needs a pad that turns or slides: with spindle.speed_rpm = 0 and "
                "pad.slide_m_s = 0 a slower feed takes off no more. Set one of them, or leave --removal out."
            )
        scenario = replace(scenario, controller=replace(scenario.controller, moment_tilt_limit_rad=0.0))
    return Checked(scenario)
