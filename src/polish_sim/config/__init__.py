"""The scenario: everything a run depends on, as plain data.

Lengths in m, angles in rad, forces in N. Each field carries its meaning, its allowed range and, where it has
one, its option on the command line: the TOML file, its checks and comments, the options and their help all
come from here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NewType

from polish_sim.config.branches import DragConfig, DualConfig, GuideConfig, HandConfig
from polish_sim.config.cell import (
    FaultsConfig,
    FlangeConfig,
    HeadConfig,
    PadConfig,
    PayloadConfig,
    RealArmConfig,
    RobotConfig,
    SafetyConfig,
    SensorConfig,
    SimulationConfig,
    SpindleConfig,
)
from polish_sim.config.control import AdaptiveConfig, BaselinesConfig, ControllerConfig
from polish_sim.config.key import RUN, Option, key
from polish_sim.config.work import LEAST_FORCE_N, PartConfig, PlanConfig, ProcessConfig, SmoothingConfig


@dataclass(frozen=True)
class Scenario:
    """One run, complete."""

    experiment: str = key("surface", "arc, force, surface, smooth, teach, dual or calibrate-payload")
    seed: int = key(
        0, "seed of everything random in the run", 0, 2**63 - 1, option=Option("--seed", RUN, "N")
    )
    part: PartConfig = PartConfig()
    plan: PlanConfig = PlanConfig()
    process: ProcessConfig = ProcessConfig()
    smoothing: SmoothingConfig = SmoothingConfig()
    controller: ControllerConfig = ControllerConfig()
    robot: RobotConfig = RobotConfig()
    sensor: SensorConfig = SensorConfig()
    payload: PayloadConfig = PayloadConfig()
    head: HeadConfig = HeadConfig()
    pad: PadConfig = PadConfig()
    spindle: SpindleConfig = SpindleConfig()
    safety: SafetyConfig = SafetyConfig()
    faults: FaultsConfig = FaultsConfig()
    guide: GuideConfig = GuideConfig()
    hand: HandConfig = HandConfig()
    dual: DualConfig = DualConfig()
    drag: DragConfig = DragConfig()
    simulation: SimulationConfig = SimulationConfig()

    @property
    def planned_by(self) -> tuple[PartConfig, PlanConfig, ProcessConfig, PadConfig]:
        """What a path is planned, or measured, by."""
        return self.part, self.plan, self.process, self.pad


Checked = NewType("Checked", Scenario)
"""A scenario that `experiments.assembly.check` has passed: what plans, proves, runs or measures asks for one.

What `dataclasses.replace` makes of one counts as one: seed, part and values may vary, not words.
"""
