"""The scenario: everything a run depends on, as plain data, a file per section (layer 1).

Lengths in m, angles in rad, forces in N. Each field carries its meaning and its allowed range: the TOML file, its
checks and its comments come from here.
"""

from polish_sim.config.adaptive import AdaptiveConfig
from polish_sim.config.baselines import BaselinesConfig
from polish_sim.config.controller import ControllerConfig
from polish_sim.config.drag import DragConfig
from polish_sim.config.dual import DualConfig
from polish_sim.config.faults import FaultsConfig
from polish_sim.config.guide import GuideConfig
from polish_sim.config.hand import HandConfig
from polish_sim.config.head import HeadConfig
from polish_sim.config.pad import PadConfig
from polish_sim.config.part import PartConfig
from polish_sim.config.payload import PayloadConfig
from polish_sim.config.plan import PlanConfig
from polish_sim.config.process import ProcessConfig
from polish_sim.config.robot import RobotConfig
from polish_sim.config.safety import SafetyConfig
from polish_sim.config.scenario import Scenario
from polish_sim.config.sensor import SensorConfig
from polish_sim.config.simulation import SimulationConfig
from polish_sim.config.smoothing import SmoothingConfig
from polish_sim.config.spindle import SpindleConfig

__all__ = [
    "AdaptiveConfig",
    "BaselinesConfig",
    "ControllerConfig",
    "DragConfig",
    "DualConfig",
    "FaultsConfig",
    "GuideConfig",
    "HandConfig",
    "HeadConfig",
    "PadConfig",
    "PartConfig",
    "PayloadConfig",
    "PlanConfig",
    "ProcessConfig",
    "RobotConfig",
    "SafetyConfig",
    "Scenario",
    "SensorConfig",
    "SimulationConfig",
    "SmoothingConfig",
    "SpindleConfig",
]
