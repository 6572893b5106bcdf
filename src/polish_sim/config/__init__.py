"""The scenario: everything a run depends on, as plain data.

Lengths in m, angles in rad, forces in N. Each field carries its meaning, its allowed range and, where it has one, its
option on the command line: the TOML file, its checks and comments, the options and their help all come from here.
"""

from polish_sim.config.branches import DragConfig, DualConfig, GuideConfig, HandConfig
from polish_sim.config.cell import (
    FaultsConfig,
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
from polish_sim.config.scenario import Scenario
from polish_sim.config.work import PartConfig, PlanConfig, ProcessConfig, SmoothingConfig
