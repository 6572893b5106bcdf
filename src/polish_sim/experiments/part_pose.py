"""Where the part stands: the pose asked for, or one from which the arm does the whole path without touching
what is around it (path -> pose, joints)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from itertools import islice
from typing import Any, NamedTuple

import mujoco
import numpy as np

from polish_sim.arrays import Array, box_middle, unit
from polish_sim.cell.guards import crash_points
from polish_sim.cell.scene import (
    STAND_NAMES,
    TABLE,
    TABLE_TOP,
    add_stand,
    add_table,
    robot_with_tool,
    stand_of,
    touching_at,
)
from polish_sim.config import Checked
from polish_sim.errors import ReachError, place_in_mm
from polish_sim.experiments.part_setup import sunk_under
from polish_sim.experiments.placement import (
    SPINS,
    Reach,
    ReachFailure,
    check_whole_path,
    default_placements,
    find_reach,
)
from polish_sim.experiments.reach_map import ReachMap, map_reach
from polish_sim.geometry import PartMesh, Surface
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.geometry.orientation import UP_CONE, side_name
from polish_sim.motion import JointPath
from polish_sim.planning.toolpath import ToolPath, pressed
from polish_sim.spatial import apply, from_pose, inverse, vectors_from_rotations

CLEARANCE_M = 0.005  #: The arm keeps this far from table, stand, part and fixture [m]
BASE_RADIUS_M = 0.11  #: Of the robot's base and pedestal [m]
_BASE_AXIS = np.linspace([0.0, 0.0, -0.75], [0.0, 0.0, 0.1], 50)
"""From the floor to the shoulder, base frame [m], shape (k, 3)."""
_SUNK_M = 1e-3
_LINKS = ("link_2", "link_3", "link_4", "link_5", "tool")
_WRIST_AND_FOREARM = ("link_5", "link_4", "link_3")


def standing_fault(mesh: PartMesh, surface: Surface, T_base_work: Array) -> str:
    """What is in the way of a part at a pose (4, 4), or that it is beside the table; empty if it can stand
    there."""
    corners = apply(T_base_work, mesh.vertices)
    low, middle = corners.min(axis=0), box_middle(corners)
    if low[2] < _BASE_AXIS[0, 2] - _SUNK_M:
        return f"it would be {1e3 * (_BASE_AXIS[0, 2] - low[2]):.0f} mm below the floor"
    if signed_distances(surface, apply(inverse(T_base_work), _BASE_AXIS)).min() < BASE_RADIUS_M:
        return "it would be in the robot's base or pedestal"
    if (np.abs(middle - TABLE.middle) > TABLE.half)[:2].any():
        (x0, y0, _), (x1, y1, _) = 1e3 * (TABLE.middle - TABLE.half), 1e3 * (TABLE.middle + TABLE.half)
        return (
            f"its middle, {place_in_mm(middle)} of the base, would be beside the table, where no stand "
            f"carries it (the table: x {x0:.0f} to {x1:.0f}, y {y0:.0f} to {y1:.0f} mm)"
        )
    return (
        f"it would be {1e3 * (TABLE_TOP - low[2]):.0f} mm inside the table"
        if low[2] < TABLE_TOP - _SUNK_M
        else ""
    )


class ArmTouch(NamedTuple):
    """What touches or comes too close first along a motion of the arm."""

    row: int  #: Of the joint angles
    names: str  #: Of the two


class ArmCheck:
    """What the arm touches at given joint angles: itself, the table, the stand, or the part in its fixture.

    The tool's own clearance of the part is the path's affair: it is the same wherever the part stands.
    ``spec`` is the arm's, of `robot_with_tool`, and gets a table and a stand; ``axes`` (n, 3) are the tool
    axes from the part to the tool, work frame. The part is ``fixed`` in a fixture, or lies alone.
    """

    def __init__(self, spec: Any, mesh: PartMesh, surface: Surface, axes: Array, fixed: bool) -> None:
        self._mesh, self._surface, self._axes = mesh, surface, axes
        self._held = "part or its fixture" if fixed else "part"
        add_table(spec)
        add_stand(spec, (TABLE, TABLE))  # of any size, see _place
        self._model = spec.compile()
        self._stand = [self._model.geom(name).id for name in STAND_NAMES]
        self._model.geom_contype[self._stand] = self._model.geom_conaffinity[self._stand] = 0
        self._data = mujoco.MjData(self._model)
        crash = crash_points(self._model)
        links = [self._model.body(name).id for name in _WRIST_AND_FOREARM]
        chosen = np.isin(crash.bodies, links)
        self._points, self._bodies = crash.points[chosen], crash.bodies[chosen]

    def first_touch(self, T_base_work: Array, q: Array) -> ArmTouch | None:
        """Find what touches or comes too close first along joint angles (n, 6) [rad]; None if nothing does.

        The part is at ``T_base_work`` (4, 4).
        """
        self._place(T_base_work)
        near: list[Array] = []
        for row, joints in enumerate(q):
            names = self._touching(joints)
            if names:
                return ArmTouch(row, names)
            R, x = self._data.xmat[self._bodies].reshape(-1, 3, 3), self._data.xpos[self._bodies]
            near.append(x + np.einsum("kij,kj->ki", R, self._points))
        points = apply(inverse(T_base_work), np.concatenate(near))
        rows = np.repeat(np.arange(len(q)), len(self._bodies))
        low = self._mesh.vertices.min(axis=0) - CLEARANCE_M
        high = self._mesh.vertices.max(axis=0) + CLEARANCE_M
        close = ((points > low) & (points < high)).all(axis=1)
        if close.any():
            close[close] = signed_distances(self._surface, points[close]) < CLEARANCE_M
        return ArmTouch(rows[close][0], f"wrist or forearm and the {self._held}") if close.any() else None

    def _place(self, T_base_work: Array) -> None:
        """Put the stand under the part, or out of the way where it needs none."""
        boxes = stand_of(apply(T_base_work, self._mesh.vertices), T_base_work, self._axes)
        for geom, box in zip(self._stand, [*boxes, TABLE, TABLE], strict=False):
            self._model.geom_pos[geom], self._model.geom_size[geom] = box
            self._model.geom_rbound[geom] = np.linalg.norm(box.half)

    def _touching(self, joints: Array) -> str:
        model, data = self._model, self._data
        if pair := touching_at(model, data, joints):
            return pair
        for link in _LINKS:
            arm = model.geom(f"{link}_collision").id
            for still in ("table", *STAND_NAMES):
                if (
                    mujoco.mj_geomDistance(model, data, arm, model.geom(still).id, CLEARANCE_M, None)
                    < CLEARANCE_M
                ):
                    return f"{link}_collision and {still}"
        return ""


# The pose asked for, or the best.


TRIED = 150  #: Poses of the reach map that are followed with the joints before the part is refused
LOOKED_AT = 60  #: Places along the path at which the arm is checked against what stands around it
SINGULAR_SHARE = 1.25
"""A path keeps this many times ``safety.singular_value_limit`` away from singularities [-]."""


class PartPlacing:
    """A path on a part, and what is needed to find the part's pose: the one asked for, or the best.

    The path is given on the surface; the arm follows it ``pressed_in`` by the contact force, or as given.
    """

    def __init__(
        self, scenario: Checked, mesh: PartMesh, surface: Surface, path: ToolPath, pressed_in: bool = True
    ) -> None:
        self._asked_pose = scenario.part.pose
        self._region = scenario.plan.region
        self._least = SINGULAR_SHARE * scenario.safety.singular_value_limit
        self.mesh = mesh
        force = path.force_at(path.s, scenario.process.contact_force_n)
        followed = pressed(path, sunk_under(force, scenario.head, scenario.pad)) if pressed_in else path
        self.positions = followed.positions_work
        self.axes = path.axes_work
        self.lowest = (mesh.vertices @ mesh.up).min()
        self._surface = surface
        spec = robot_with_tool(scenario)
        self._arm = ArmCheck(spec, mesh, surface, path.axes_work, bool(scenario.part.fixture_file))

    def map(self) -> ReachMap:
        """How well the arm does the path wherever the part may stand."""
        return map_reach(self.positions, self.axes, self.mesh.up, self.lowest)

    def reach(self) -> Reach:
        """The pose asked for or, without one, a chosen one, and how the arm does the path there.

        Raises:
            ReachError: As ``given`` or ``chosen``.
        """
        return self.given() if self._asked_pose else self.chosen()

    def chosen(self) -> Reach:
        """A pose in front of the robot; if none will do there, the first of the reach map's that does.

        Raises:
            ReachError: The arm does the path nowhere; names the first bad point where it came furthest.
        """
        try:
            return self._reach(default_placements(self.positions, self.mesh.up, self.lowest))
        except ReachError as error:
            nowhere = error
        if reach := self.on_map(TRIED):
            return reach
        if self._region == "all":
            raise ReachError(
                f"{nowhere} 'polish-sim plan PART --region all' splits the part into setups: run each with "
                "--path FOLDER/setup_N."
            )
        looks = unit(self.axes.mean(axis=0))
        if looks @ self.mesh.up < np.cos(UP_CONE) < (self.axes @ looks).min():
            raise ReachError(
                f"{nowhere} Or turn the side up that the path is on: --up {side_name(np.round(looks, 1))}."
            )
        raise nowhere

    def on_map(self, tried: int) -> Reach | None:
        """The first feasible of the ``tried`` best poses of the reach map, best of each height and distance
        first."""
        for T_base_work, spin in islice(self.map().best_first(), tried):
            with suppress(ReachError):
                return self._reach([T_base_work], (spin,))
        return None

    def hindered(self, reach: Reach) -> str:
        """What hinders the arm between the places `find_reach` looks at; empty if nothing does."""
        failure = self.hindrance(reach.T_base_work, reach.follow(self.positions, self.axes))
        return failure.reason if failure else ""

    def given(self) -> Reach:
        """The pose asked for.

        Raises:
            ReachError: The part cannot stand there, or the arm does not do the path; names one that fits.
        """
        T_base_work = from_pose(self._asked_pose)
        try:
            if fault := standing_fault(self.mesh, self._surface, T_base_work):
                raise ReachError(f"the part cannot stand at the pose asked for: {fault}.")
            return self._reach([T_base_work])
        except ReachError as error:
            raise ReachError(f"{error} {self._advice()}") from None

    def _reach(self, placements: Iterable[Array], spins: Sequence[float] = SPINS) -> Reach:
        reach = find_reach(
            self.positions,
            self.axes,
            placements,
            above_table=True,
            spins=spins,
            hindrance=self.hindrance,
        )
        joints = check_whole_path(reach, self.positions, self.axes)
        return reach._replace(q_start=np.array(joints.q[0]))

    def hindrance(self, T_base_work: Array, joints: JointPath) -> ReachFailure | None:
        """Why the arm cannot follow joints that are within its range; None if it can."""
        if joints.smallest_singular_value < self._least:
            return ReachFailure(joints.smallest_singular_index, "the arm is near a singularity")
        if fault := standing_fault(self.mesh, self._surface, T_base_work):
            return ReachFailure(0, f"the part cannot stand there: {fault}")
        every = max(1, len(joints.q) // LOOKED_AT)
        touch = self._arm.first_touch(T_base_work, joints.q[::every])
        return ReachFailure(touch.row * every, f"{touch.names} would touch") if touch else None

    def _advice(self) -> str:
        """A pose the arm reaches, as the option takes it."""
        try:
            T = self.chosen().T_base_work
        except ReachError as error:
            return f"No other pose was found either: {error}"
        turn = np.degrees(vectors_from_rotations(T[:3, :3]))
        numbers = ",".join(f"{round(float(value), 3) + 0.0:.7g}" for value in [*(1e3 * T[:3, 3]), *turn])
        return f"It fits with --part-pose {numbers}, or leave --part-pose out."
