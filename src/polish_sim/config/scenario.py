"""The scenario: everything a run depends on, section by section (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass, field

from polish_sim.config.controller import ControllerConfig
from polish_sim.config.drag import DragConfig
from polish_sim.config.dual import DualConfig
from polish_sim.config.faults import FaultsConfig
from polish_sim.config.guide import GuideConfig
from polish_sim.config.hand import HandConfig
from polish_sim.config.head import HeadConfig
from polish_sim.config.key import key
from polish_sim.config.pad import PadConfig
from polish_sim.config.part import PartConfig
from polish_sim.config.payload import PayloadConfig
from polish_sim.config.plan import PlanConfig
from polish_sim.config.process import ProcessConfig
from polish_sim.config.robot import RobotConfig
from polish_sim.config.safety import SafetyConfig
from polish_sim.config.sensor import SensorConfig
from polish_sim.config.simulation import SimulationConfig
from polish_sim.config.smoothing import SmoothingConfig
from polish_sim.config.spindle import SpindleConfig


@dataclass(frozen=True)
class Scenario:
    """One run, complete."""

    experiment: str = key("surface", "arc, force, surface, smooth, teach, dual or calibrate-payload")
    seed: int = key(0, "seed of everything random in the run", 0, 2**63 - 1)
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
