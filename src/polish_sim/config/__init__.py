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
from polish_sim.config.work import PartConfig, PlanConfig, ProcessConfig, SmoothingConfig


@dataclass(frozen=True)
class Scenario:
    """One run, complete."""

    experiment: str = key("surface", "arc, force, surface, smooth, teach, dual or calibrate-payload")
    seed: int = key(
        0, "seed of everything random in the run", 0, 2**63 - 1, option=Option("--seed", RUN, "N")
    )
    part: PartConfig = field(default_factory=PartConfig)
    plan: PlanConfig = field(default_factory=PlanConfig)
    process: ProcessConfig = field(default_factory=ProcessConfig)
    smoothing: SmoothingConfig = field(default_factory=SmoothingConfig)
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    payload: PayloadConfig = field(default_factory=PayloadConfig)
    head: HeadConfig = field(default_factory=HeadConfig)
    pad: PadConfig = field(default_factory=PadConfig)
    spindle: SpindleConfig = field(default_factory=SpindleConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)
    faults: FaultsConfig = field(default_factory=FaultsConfig)
    guide: GuideConfig = field(default_factory=GuideConfig)
    hand: HandConfig = field(default_factory=HandConfig)
    dual: DualConfig = field(default_factory=DualConfig)
    drag: DragConfig = field(default_factory=DragConfig)
    simulation: SimulationConfig = field(default_factory=SimulationConfig)


Checked = NewType("Checked", Scenario)
"""A scenario that `experiments.assembly.check` has passed: what plans, proves, runs or measures asks for one.

What `dataclasses.replace` makes of one counts as one: seed, part and values may vary, not words.
"""
