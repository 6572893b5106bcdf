"""Where the part stands: the pose asked for, or one from which the arm does the whole path (path -> pose,
joints)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.cell import tool_on_flange
from polish_sim.cell.arm_check import ArmCheck, standing_fault
from polish_sim.cell.scene import robot_with_tool
from polish_sim.config import Checked
from polish_sim.errors import ReachError
from polish_sim.experiments.part_setup import pressing_depths
from polish_sim.experiments.placement import (
    SPINS,
    Reach,
    ReachFailure,
    check_whole_path,
    default_placements,
    find_reach,
    given_placement,
)
from polish_sim.experiments.reach_map import ReachMap, map_reach
from polish_sim.motion import JointPath
from polish_sim.planning.toolpath import ToolPath, pressed

if TYPE_CHECKING:
    from polish_sim.geometry import PartMesh, Surface

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
        self.scenario, self.mesh = scenario, mesh
        followed = pressed(path, pressing_depths(scenario, path)) if pressed_in else path
        self.positions = followed.positions_work
        self.axes = path.axes_work
        self.lowest = float((mesh.vertices @ mesh.up).min())
        self._surface = surface
        spec = robot_with_tool(scenario)
        self._arm = ArmCheck(spec, mesh, surface, path.axes_work, bool(scenario.part.fixture_file))

    def map(self) -> ReachMap:
        """How well the arm does the path wherever the part may stand."""
        return map_reach(self.positions, self.axes, self.mesh.up, self.lowest, tool_on_flange())

    def reach(self) -> Reach:
        """The pose asked for or, without one, a chosen one, and how the arm does the path there.

        Raises:
            ReachError: As ``given`` or ``chosen``.
        """
        return self.given() if self.scenario.part.pose else self.chosen()

    def chosen(self) -> Reach:
        """A pose in front of the robot; if none will do there, the first of the reach map's that does.

        Raises:
            ReachError: The arm does the path nowhere; names the first bad point where it came furthest.
        """
        try:
            return self._reach(default_placements(self.positions, self.mesh.up, self.lowest))
        except ReachError as error:
            nowhere = error
        reach = self.on_map(TRIED)
        if reach is None and self.scenario.plan.region == "all":
            raise ReachError(
                f"{nowhere} 'polish-sim plan PART --region all' splits the part into setups: run each with "
                "--path FOLDER/setup_N."
            )
        if reach is None:
            raise nowhere
        return reach

    def on_map(self, tried: int) -> Reach | None:
        """The first feasible of the ``tried`` best poses of the reach map, best of each height and distance
        first."""
        for T_base_work, spin in islice(self.map().best_first(), tried):
            with suppress(ReachError):
                return self._reach(iter([T_base_work]), (spin,))
        return None

    def given(self) -> Reach:
        """The pose asked for.

        Raises:
            ReachError: The part cannot stand there, or the arm does not do the path; names one that fits.
        """
        pose = self.scenario.part.pose
        fault = standing_fault(self.mesh, self._surface, next(given_placement(pose)))
        try:
            if fault:
                raise ReachError(f"the part cannot stand at the pose asked for: {fault}.")
            return self._reach(given_placement(pose))
        except ReachError as error:
            raise ReachError(f"{error} {self._advice()}") from None

    def _reach(self, placements: Iterator[Array], spins: Sequence[float] = SPINS) -> Reach:
        tool = tool_on_flange()
        reach = find_reach(
            self.positions,
            self.axes,
            placements,
            tool,
            above_table=True,
            spins=spins,
            hindrance=self.hindrance,
        )
        joints = check_whole_path(reach, self.positions, self.axes, tool)
        return reach._replace(q_start=np.array(joints.q[0]))

    def hindrance(self, T_base_work: Array, joints: JointPath) -> ReachFailure | None:
        """Why the arm cannot follow joints that are within its range; None if it can."""
        least = SINGULAR_SHARE * self.scenario.safety.singular_value_limit
        if joints.smallest_singular_value < least:
            return ReachFailure(joints.smallest_singular_index, "the arm is near a singularity")
        fault = standing_fault(self.mesh, self._surface, T_base_work)
        if fault:
            return ReachFailure(0, f"the part cannot stand there: {fault}")
        every = max(1, len(joints.q) // LOOKED_AT)
        touch = self._arm.first_touch(T_base_work, joints.q[::every])
        return None if touch is None else ReachFailure(touch.row * every, f"{touch.names} would touch")

    def _advice(self) -> str:
        """A pose the arm reaches, as the option takes it."""
        try:
            T = self.chosen().T_base_work
        except ReachError as error:
            return f"No other pose was found either: {error}"
        turn = np.degrees(Rotation.from_matrix(T[:3, :3]).as_rotvec())
        numbers = ",".join(f"{round(float(value), 3) + 0.0:.7g}" for value in [*(1e3 * T[:3, 3]), *turn])
        return f"It fits with --part-pose {numbers}, or leave --part-pose out."


def reach_path(
    scenario: Checked, mesh: PartMesh, surface: Surface, path: ToolPath, pressed_in: bool = True
) -> Reach:
    """Place the part and check that the arm does the whole path, ``pressed_in`` or as given, and lifted off.

    Raises:
        ReachError: Naming the first point that cannot be done.
    """
    return PartPlacing(scenario, mesh, surface, path, pressed_in).reach()
