"""The chain two robots close over one part (paper 2), and both arms in it: as built, gears included, and as
believed.

master_T_flange1 = master_T_work (gripper_T_work)^-1 (flange1_T_gripper)^-1
follower_T_flange2 = (master_T_follower)^-1 master_T_work work_T_tool (flange2_T_tool)^-1
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import mujoco
import numpy as np

from polish_sim.arms import FIRST
from polish_sim.arrays import Array
from polish_sim.calibration.arm import Tolerance, links_behind
from polish_sim.cell.real_arm import ArmPlace, RestingArm, built_table, resting_arm
from polish_sim.cell.scene import robot_with_tool
from polish_sim.config import DualConfig, RealArmConfig, RobotConfig, Scenario
from polish_sim.dual.calibrate import Flanges, Reading, built_arm, simulate_tracked, wrong_table
from polish_sim.dual.calibration.arm import PairTables, fit_pair, read_arm_calibration
from polish_sim.dual.calibration.bases import ROBOTS
from polish_sim.dual.carrier import FOLLOWER_ARM, MASTER_ARM
from polish_sim.errors import ReachError
from polish_sim.experiments.beliefs import POSES, TRACKER
from polish_sim.motion import forward
from polish_sim.motion.kinematics import (
    NOMINAL,
    inverse_near,
    inverse_with_table,
    is_nominal,
)
from polish_sim.spatial import inverse, vectors_from_rotations


class ClosedChain(NamedTuple):
    """The fixed transforms of the chain; each (4, 4)."""

    T_master_follower: Array  #: The follower's base in the master's, from base calibration
    T_flange_gripper: Array  #: The gripper on the master's flange, from tool calibration
    T_gripper_work: Array  #: The part in the gripper, from assembly
    T_flange_tool: Array  #: The tool on the follower's flange, from tool calibration

    @property
    def T_flange_work(self) -> Array:
        """The part on the master's flange, shape (4, 4)."""
        return self.T_flange_gripper @ self.T_gripper_work

    def master_flange(self, T_master_work: Array) -> Array:
        """Flange of the master for a pose of the part, both (..., 4, 4)."""
        return T_master_work @ inverse(self.T_flange_work)

    def follower_flange(self, T_master_work: Array, T_work_tool: Array) -> Array:
        """Flange of the follower, in its own base, for a pose of the tool on the part, shape (..., 4, 4)."""
        return inverse(self.T_master_follower) @ T_master_work @ T_work_tool @ inverse(self.T_flange_tool)

    def residual(self, T_master_flange: Array, T_follower_flange: Array, T_work_tool: Array) -> Array:
        """How far the chain is from closing, for both flanges in their bases and the wanted tool pose, each
        (n, 4, 4).

        Returns the displacement [m] and rotation vector [rad] of the actual tool pose, axes of the wanted
        one, (n, 6).
        """
        wanted = T_master_flange @ self.T_flange_gripper @ self.T_gripper_work @ T_work_tool
        actual = self.T_master_follower @ T_follower_flange @ self.T_flange_tool
        off = inverse(wanted) @ actual
        return np.concatenate([off[:, :3, 3], vectors_from_rotations(off[:, :3, :3])], axis=1)


def follow_joints(T_base_flange: Array, q_near: Array, arm: str) -> Array:
    """Joints (n, 6) [rad] along flange poses, from near ``q_near``, each close to the last and inside the
    limits.

    Raises ReachError, which names the arm and the pose it cannot reach.
    """
    joints = [q_near]
    for k, T in enumerate(T_base_flange, 1):
        try:
            joints.append(inverse_near(T, joints[-1]))
        except ReachError as error:
            raise ReachError(f"the {arm} at point {k} of {len(T_base_flange)}: {error}") from error
    return np.stack(joints[1:])


_NOMINAL = dict.fromkeys(ROBOTS, NOMINAL)
_RIGID = dict.fromkeys(ROBOTS, np.zeros((6, 7)))


class PairArms(NamedTuple):
    """Tables of both arms, robot by robot, each (4, 6)."""

    true: Mapping[str, Array] = _NOMINAL  #: As they are built: the engine moves these
    believed: Mapping[str, Array] = _NOMINAL  #: The host computes with these
    #: T_master_follower and covariance (6, 6), if found with the tables
    bases: tuple[Array, Array] | None = None
    gears: Mapping[str, RestingArm] | None = None  #: Between encoders and links; None: rigid
    known: Mapping[str, Array] = _RIGID  #: What the host knows of them, as `ArmEstimate.gears`

    def flanges(self, robot: str, q: Array) -> Array:
        """Where the flange of an arm really is in its base with joints (n, 6) [rad], shape (n, 4, 4)."""
        return forward(q, self.true[robot])

    def rest(self, robot: str, q: Array, rng: np.random.Generator | None = None) -> Array:
        """Where the links are, (n, 6) [rad], with the arm at rest and its encoders at ``q``; ``rng``: see
        `links`."""
        return self.gears[robot].links(q, rng) if self.gears else q

    def standing(self, rng: np.random.Generator) -> Flanges:
        """Where flanges are with the arms at rest and their encoders somewhere."""
        return lambda robot, q: self.flanges(robot, self.rest(robot, q, rng))

    def resting_flange(self, robot: str, q: Array) -> Array:
        """Where the flange is in its base, (4, 4), before anything moves, with the encoders at ``q`` (6,)
        [rad]."""
        return self.flanges(robot, self.rest(robot, q[None]))[0]

    def joints(self, robot: str, T_base_flange: Array, q: Array) -> Array:
        """Joint angles with which the host expects the flange there, from the nominal arm's (n, 6) [rad]."""
        table = self.believed[robot]
        return q if is_nominal(table) else inverse_with_table(table, T_base_flange, q)

    def reading(self, robot: str, rng: np.random.Generator) -> Reading | None:
        """What the host reads when an arm is led until its flange really is where it should be; None: just
        that."""
        true, believed, arms = self.true[robot], self.believed[robot], self.gears
        if is_nominal(true) and is_nominal(believed) and not arms:
            return None

        def read(T_base_flange: Array, q: Array) -> Array:
            q = inverse_with_table(true, T_base_flange, q)
            if arms:
                arm = arms[robot]
                read = arm.encoders(q, rng)
                q = links_behind(read, arm.weight(read), self.known[robot], arm.real)
            return forward(q, believed)

        return read


NOMINAL_ARMS = PairArms()
PLACES = MappingProxyType(dict(zip(ROBOTS, (MASTER_ARM, FOLLOWER_ARM), strict=True)))


def real_arms(
    real: RealArmConfig,
    seed: int,
    model: mujoco.MjModel,
    q_work: Mapping[str, Array],
    places: Mapping[str, ArmPlace] = PLACES,
) -> PairArms:
    """Both arms with their gears and with what the maker's calibration around the work, at (6,) [rad], has
    left.

    ``model``: the scene of both, which weighs them.
    """
    return PairArms(
        {robot: built_table(real, seed, model, q_work[robot], place) for robot, place in places.items()},
        gears={robot: resting_arm(real, seed, model, place) for robot, place in places.items()},
    )


def lone_arms(seed: int, q_work: Array) -> PairArms:
    """The arms of a seed with the cell's tool and no part, calibrated by the maker around ``q_work`` (6,)
    [rad]."""
    robot = RobotConfig(arm=FIRST)
    model = robot_with_tool(Scenario(robot=robot)).compile()
    places = dict(zip(ROBOTS, (ArmPlace(number=MASTER_ARM.number), ArmPlace()), strict=True))
    return real_arms(robot.real, seed, model, dict.fromkeys(ROBOTS, q_work), places)


def pair_arms(
    config: DualConfig,
    compensation: str,
    T_tracker_base: Mapping[str, Array],
    rng: np.random.Generator,
    made: PairArms = NOMINAL_ARMS,
) -> PairArms:
    """Both arms, which stand at ``T_tracker_base`` before a simulated tracker; ``made``: as the maker has
    left them, ``compensation``: what the host is to know of them, as ``robot.compensation``.

    Raises:
        CalibrationError: The calibration on file is another pair's, or of arms of another make.
    """
    if config.arms_file:
        found = read_arm_calibration(Path(config.arms_file), config.pair)
        true = found.true_tables or found.tables
        bases = found.T_master_follower, found.covariance
        return PairArms(true, found.tables, bases, made.gears, found.gears)
    tolerance = Tolerance(config.arm_length_error_m, config.arm_angle_error_rad)
    true = (
        {name: wrong_table(tolerance, rng, table) for name, table in made.true.items()}
        if any(tolerance)
        else made.true
    )
    poses = config.arm_poses or (POSES if compensation == TRACKER else 0)
    if poses == 0:
        return made._replace(true=true)
    arms = PairTables({robot: built_arm(true[robot], T_tracker_base[robot]) for robot in ROBOTS})
    tracked = simulate_tracked(arms, poses, config.tracker_noise_m, rng, made.gears)
    # Gears err by more than the tracker: how much, the residuals say.
    fit = fit_pair(tracked, None if made.gears else max(config.tracker_noise_m, 1e-9), Tolerance())
    known = {robot: arm.gears for robot, arm in fit.arms.items()}
    return PairArms(true, fit.tables, fit.bases, made.gears, known)
