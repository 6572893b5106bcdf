"""Which side up, and how often: few setups in which pad and arm reach all of a part (scenario -> setups).

A setup is one side up and one pose of the part. What the arm does in one is tried with the reach map along a
rough way over patches: first those that look up, then those that look to the side or down, the largest first.
The side that shows most of what is left is taken, until nothing is left or no side shows more of it (greedy
set cover).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, unit
from polish_sim.cell import Observer
from polish_sim.config import Checked
from polish_sim.errors import PlanError
from polish_sim.experiments.part_pose import PartPlacing
from polish_sim.experiments.reach_map import outermost
from polish_sim.geometry import PartMesh, Surface, fit_surface
from polish_sim.geometry.fit import joined_meshes, joined_surfaces, load_fixture
from polish_sim.geometry.orientation import SIDES, UP_CONE, side_name
from polish_sim.geometry.regions.patches import facing, middle_points
from polish_sim.geometry.regions.region import SLIVER_SHARE, inside_margins, patches_of
from polish_sim.planning.feasibility import check_asked
from polish_sim.planning.moves.travel import nearest_neighbours, turn_between
from polish_sim.planning.part_plan import load_mesh, prepare_region
from polish_sim.planning.quality.tool_room import Tool
from polish_sim.planning.toolpath import PROCESS, ToolPath, arc_length

ALIKE = np.cos(np.radians(20.0))  #: Patches that look ways this close are tried together
SAME_SIDE = np.cos(np.radians(5.0))  #: Sides up that are closer are one
MOST_SIDES = 4  #: Sides up that are tried before each setup
POSES = 40  #: Of the reach map, that are tried for each way
MOST_FACETS = 400  #: Of a patch, whose corners are looked at
AROUND = 12  #: Points of a way round the part
BETWEEN = 3  #: Points of a way from place to place of a patch
SAME = 1e-3  #: Of sides that show as much, relative, the first is taken
MOST_REFUSED = 12  #: Setups that turn out not to be done, after which each patch is a setup of its own


class Patch(NamedTuple):
    """A piece of the part's surface that one setup polishes as a whole."""

    number: int  #: As ``--region all:N,N,.../SIDE`` counts it, from 1
    area: float  #: [m^2]
    way: Array  #: Where it looks, unit vector, shape (3,)
    middle: Array  #: A place on it [m], shape (3,)
    points: Array  #: Of a way over it [m], shape (k, 3)
    axes: Array  #: Its normals there, shape (k, 3)


class Setup(NamedTuple):
    """One side up and what is polished then."""

    up: Array  #: Unit vector, shape (3,)
    patches: tuple[Patch, ...]
    scenario: Checked  #: That plans it


class SetupSearch:
    """Finds setups one after another, all for one pad; what turns out not to be done in one is looked at
    again."""

    def __init__(self, scenario: Checked, observer: Observer) -> None:
        check_asked(scenario.part, scenario.plan, scenario.pad)
        self._observer = observer
        mesh = load_mesh(scenario.part, observer)
        observer.stage("fit the surface")
        surface = fit_surface(mesh, scenario.plan.feature_angle_rad)
        fixture = load_fixture(scenario.part.fixture_file, mesh)
        self._standing = joined_meshes(mesh, fixture), joined_surfaces(surface, fixture)
        observer.stage("look for what the pad reaches")
        pieces = patches_of(surface, mesh)
        patches = [_patch(number, piece.surface) for number, piece in enumerate(pieces, 1)]
        self.count = len(patches)
        self.part_area = sum(patch.area for patch in patches)
        self.left: list[Patch] = []
        self.given_up: list[tuple[Patch, str]] = []  #: What cannot be planned, and why
        self.notes: tuple[str, ...] = ()  #: On the pad and the search
        for looked_at, patch in enumerate(sorted(patches, key=lambda patch: -patch.area)):
            observer.progress(looked_at, self.count)
            try:
                if self.left and patch.area < SLIVER_SHARE * self.left[0].area:
                    raise PlanError(f"smaller than {SLIVER_SHARE:.1%} of the largest patch")
                plan = scenario.plan
                region = inside_margins(
                    [pieces[patch.number - 1]], mesh.up, plan.edge_margin_m, plan.hole_margin_m
                )
                tool = Tool(scenario.pad, scenario.process.contact_force_n, fixture)
                ready = prepare_region(mesh, surface, region, plan, scenario.process, tool)
            except PlanError as error:
                self.given_up.append((patch, str(error)))
                continue
            if not self.left:  # the pad of the largest is the pad of all
                self.notes = ready.notes
                scenario = replace(scenario, plan=ready.plan, pad=replace(ready.tool.pad, choice="given"))
            self.left.append(patch)
        if not self.left:
            raise PlanError(self.given_up[0][1])
        self._scenario = scenario
        self._counted_by = side_name(mesh.up)
        self._sides = [mesh.up] if scenario.part.up != "auto" else _sides(mesh, self.left)
        self._refused: list[tuple[Array | None, frozenset[int]]] = []
        #: Whether the arm does patches with a side up, as tried so far
        self._fitting: dict[tuple[str, frozenset[int]], bool] = {}

    def next(self) -> Setup | None:
        """The side that shows most of what is left; None if nothing is left or no side shows any of it."""
        if not self.left:
            return None
        self._observer.stage("look for the side up")
        best: tuple[float, Array, Sequence[Patch]] = (0.0, self._sides[0], ())
        for tried, up in enumerate(sorted(self._sides, key=self._in_view, reverse=True)[:MOST_SIDES]):
            seen = self._seen(up)
            area = sum(patch.area for patch in seen)
            best = (area, up, seen) if area > (1.0 + SAME) * best[0] else best
            if len(seen) == len(self.left):
                break
            self._observer.progress(tried + 1, MOST_SIDES)
        _, up, shown = best
        if not shown:
            return None
        numbers = sorted(patch.number for patch in shown)
        self.left = [patch for patch in self.left if patch.number not in numbers]
        region = f"all:{','.join(map(str, numbers))}/{self._counted_by}"
        part = replace(self._scenario.part, up=side_name(up))
        plan = replace(self._scenario.plan, region=region)
        return Setup(up, tuple(shown), replace(self._scenario, part=part, plan=plan))

    def refuse(self, setup: Setup, why: str, elsewhere: bool) -> None:
        """Take back a setup that cannot be done; it may be ``elsewhere``, with another side up, or not at
        all.

        Less than its patches is tried instead; a single one that cannot be done elsewhere is given up with
        the reason.
        """
        if len(setup.patches) == 1 and not elsewhere:
            self.given_up.append((setup.patches[0], why))
            return
        self.left += setup.patches
        self._refused.append(
            (setup.up if elsewhere else None, frozenset(patch.number for patch in setup.patches))
        )
        if len(self._refused) == MOST_REFUSED:
            self.notes += (
                f"after {MOST_REFUSED} setups that could not be done each patch was a setup of its own, and "
                f"there may be more than are needed. The last that could not be done: {why}",
            )

    def _in_view(self, up: Array) -> float:
        """Area of what looks up or, for less, to the side [m^2]: sides that show much are tried first."""
        return round(
            sum(patch.area * float(np.clip(0.5 + patch.way @ up, 0.0, 1.0)) for patch in self.left), 7
        )

    def _seen(self, up: Array) -> list[Patch]:
        """What the arm reaches in one pose with a side up."""
        order = sorted(self.left, key=lambda patch: (patch.way @ up < np.cos(UP_CONE), -patch.area))
        groups: list[list[Patch]] = []
        for patch in order:
            group = next((group for group in groups if group[0].way @ patch.way > ALIKE), None)
            groups.append([patch]) if group is None else group.append(patch)
        seen: list[Patch] = []
        for group in groups:
            seen += self._more(up, seen, group)
        return seen

    def _more(self, up: Array, seen: Sequence[Patch], group: Sequence[Patch]) -> Sequence[Patch]:
        """What of a group the arm reaches besides what it does already."""
        if self._fits(up, [*seen, *group]):
            return group
        if len(group) == 1:
            return ()
        first = self._more(up, seen, group[: len(group) // 2])
        return [*first, *self._more(up, [*seen, *first], group[len(group) // 2 :])]

    def _fits(self, up: Array, patches: Sequence[Patch]) -> bool:
        numbers = {patch.number for patch in patches}
        if any((side is None or side is up) and refused <= numbers for side, refused in self._refused) or (
            len(numbers) > 1 and len(self._refused) >= MOST_REFUSED
        ):
            return False
        asked = side_name(up), frozenset(numbers)
        if asked not in self._fitting:
            mesh, surface = self._standing
            way = _way_over(mesh, patches, self._scenario.plan.clearance_m)
            placing = PartPlacing(self._scenario, replace(mesh, up=up), surface, way)
            self._fitting[asked] = placing.on_map(POSES) is not None
        return self._fitting[asked]


def _patch(number: int, surface: Surface) -> Patch:
    rows = slice(None, None, -(-len(surface.faces) // MOST_FACETS))
    points, axes = (
        field[rows, :3].reshape(-1, 3) for field in (surface.control, unit(surface.normal_control))
    )
    places = outermost(points, axes)
    order = places[nearest_neighbours(np.repeat(points[places, None], 2, axis=1), True, None)[0]]
    share = np.linspace(0.0, 1.0, BETWEEN, endpoint=False)[:, None]
    way, normals = (
        np.concatenate([(1.0 - share) * field[a] + share * field[b] for a, b in pairwise(order)])
        for field in (points, axes)
    )
    middle = middle_points(surface).positions[surface.facet_areas.argmax()]
    return Patch(number, surface.facet_areas.sum(), unit(facing(surface)), middle, way, unit(normals))


def _way_over(mesh: PartMesh, patches: Sequence[Patch], clearance: float) -> ToolPath:
    """A rough way from patch to patch and round the part between them, at a clearance [m]; nothing to polish
    by."""
    middle = mesh.vertices.mean(axis=0)
    points, axes = [patches[0].points], [patches[0].axes]
    for patch in patches[1:]:
        ways = turn_between(axes[-1][-1], patch.axes[0], np.linspace(0.0, 1.0, AROUND))
        high = ((mesh.vertices - middle) @ ways.T).max(axis=0) + clearance
        points += [middle + high[:, None] * ways, patch.points]
        axes += [ways, patch.axes]
    positions = np.concatenate(points)
    segment, nothing = np.full(len(positions), PROCESS, dtype=np.int8), np.zeros(len(positions))
    return ToolPath(
        positions, np.concatenate(axes), arc_length(positions), nothing.astype(np.int64), segment, nothing
    )


def _sides(mesh: PartMesh, patches: Sequence[Patch]) -> list[Array]:
    """Sides that may be turned up: the usual one, the file's own, those patches look to, the part's principal
    axes."""
    principal = np.linalg.eigh(np.cov(mesh.vertices.T))[1].T
    sides: list[Array] = []
    for way in [
        mesh.up,
        *map(np.array, SIDES.values()),
        *(patch.way for patch in patches),
        *principal,
        *-principal,
    ]:
        if all(way @ side < SAME_SIDE for side in sides):
            sides.append(way)
    return sides
