"""Tables of both arms in a run: as they are built, and as the host believes them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.config import DualConfig
from polish_sim.dual.calibrate_bases import built_arm, simulate_tracked, wrong_table
from polish_sim.dual.calibrate_tcp import Reading
from polish_sim.dual.calibration.arm import LEAST_POSES, PairTables, Tolerance, fit_pair, read_arm_calibration
from polish_sim.dual.calibration.bases import ROBOTS
from polish_sim.errors import ConfigError
from polish_sim.motion import forward
from polish_sim.motion.kinematics import NOMINAL, inverse_with_table, is_nominal

_NOMINAL: Final = dict.fromkeys(ROBOTS, NOMINAL)


class PairArms(NamedTuple):
    """Tables of both arms, robot by robot, each (4, 6)."""

    true: Mapping[str, Array] = _NOMINAL  #: As they are built: the engine moves these
    believed: Mapping[str, Array] = _NOMINAL  #: The host computes with these
    bases: tuple[Array, Array] | None = None  #: T_master_follower and covariance (6, 6), if found with the tables

    @property
    def nominal(self) -> bool:
        """Whether both arms are built as the nominal table says."""
        return all(map(is_nominal, self.true.values()))

    def flanges(self, robot: str, q: Array) -> Array:
        """Where the flange of an arm really is in its base with joints (n, 6) [rad], shape (n, 4, 4)."""
        return forward(q, self.true[robot])

    def joints(self, robot: str, T_base_flange: Array, q: Array) -> Array:
        """Joint angles with which the host expects the flange there, from the nominal arm's (n, 6) [rad]."""
        table = self.believed[robot]
        return q if is_nominal(table) else inverse_with_table(table, T_base_flange, q)

    def reading(self, robot: str) -> Reading | None:
        """What the host reads when an arm is led until its flange really is where it should be; None: just that."""
        true, believed = self.true[robot], self.believed[robot]
        if is_nominal(true) and is_nominal(believed):
            return None
        return lambda T_base_flange, q: forward(inverse_with_table(true, T_base_flange, q), believed)


NOMINAL_ARMS: Final = PairArms()


def pair_arms(config: DualConfig, T_tracker_base: Mapping[str, Array], rng: np.random.Generator) -> PairArms:
    """Both arms of a scenario, which stand at ``T_tracker_base`` before a simulated tracker.

    Raises:
        ConfigError: Two sources of one thing, or too few poses.
        CalibrationError: The calibration on file is another pair's, or of arms that are no UR5e.
    """
    if config.arms_file or config.arm_poses:
        _refuse_second_source(config)
    if config.arms_file:
        found = read_arm_calibration(Path(config.arms_file), config.pair)
        return PairArms(found.true_tables or found.tables, found.tables, (found.T_master_follower, found.covariance))
    tolerance = Tolerance(config.arm_length_error_m, config.arm_angle_error_rad)
    true = {robot: wrong_table(tolerance, rng) if any(tolerance) else NOMINAL for robot in ROBOTS}
    if config.arm_poses == 0:
        return PairArms(true)
    if config.arm_poses < LEAST_POSES:
        raise ConfigError(
            f"dual.arm_poses = {config.arm_poses} cannot tell an arm's table: 0 for none, else {LEAST_POSES} or more."
        )
    arms = PairTables({robot: built_arm(true[robot], T_tracker_base[robot]) for robot in ROBOTS})
    tracked = simulate_tracked(arms, config.arm_poses, config.tracker_noise_m, rng)
    fit = fit_pair(tracked, max(config.tracker_noise_m, 1e-9), Tolerance())
    return PairArms(true, fit.tables, fit.bases)


def _refuse_second_source(config: DualConfig) -> None:
    """Refuse settings beside a calibration of the arms that say the same, or that assume the nominal table."""
    source, others = "dual.arm_poses", ["bases_file"]
    if config.arms_file:
        source, others = "dual.arms_file", [*others, "arm_poses", "arm_length_error_m", "arm_angle_error_rad"]
    given = [f"dual.{name}" for name in others if getattr(config, name)]
    if given:
        raise ConfigError(
            f"{', '.join(given)} beside {source}: the calibration of the arms says how they are and where "
            "the follower's base stands. Give one of the two."
        )
    if config.tool_file:
        raise ConfigError(
            f"dual.tool_file beside {source}: '{config.tool_file}' was measured on the flange of an arm as "
            "the nominal table has it, not as the calibration of the arms has it. Leave the tool's file out: the run "
            "calibrates its tool with the arms' own tables."
        )
