"""The battery: the cases every controller is scored by; docs/score.md says how to copy it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np

from polish_sim.arms import FIRST
from polish_sim.config import Scenario
from polish_sim.errors import unknown_name
from polish_sim.experiments import default_scenario
from polish_sim.experiments.registry import experiment
from polish_sim.scenario_file import override
from polish_sim.scoring.loop_model import share_latency

# What a case of the scorecard is, and who is scored in it: plain data.


class Entry(NamedTuple):
    """A controller that is scored."""

    label: str  #: What tables call it
    name: str  #: What the scenario calls it: a shipped controller, or ``FILE.py:CLASS`` with an absolute path
    settings: tuple[str, ...] = ()  #: ``KEY=VALUE`` of the config that belong to it, e.g. gains.


class Draw(NamedTuple):
    """A key of the config that every seed draws anew, evenly within a range."""

    key: str
    low: float
    high: float


@dataclass(frozen=True)
class Case:
    """One case: an experiment's default scenario with a few keys changed."""

    name: str
    text: str  #: What is run, in one line
    #: ``force``: a hold, measured in its steady window; ``surface``: a path, measured while fed
    experiment: str
    settings: tuple[str, ...] = ()  #: ``KEY=VALUE`` of the config
    draws: tuple[Draw, ...] = ()
    repeats: int = 1  #: How many times as many seeds as the other cases it gets

    @property
    def moving(self) -> bool:
        """Whether the tool is fed along a path; else it holds one point."""
        return not experiment(self.experiment).holds

    def scenario(self, entry: Entry, seed: int) -> Scenario:
        """The complete scenario of one row; ConfigError if a setting does not fit the config."""
        rng = np.random.default_rng([seed, 0x5C0FE])
        drawn = [f"{draw.key}={rng.uniform(draw.low, draw.high)!r}" for draw in self.draws]
        scenario = override(default_scenario(self.experiment), [*self.settings, *drawn, *entry.settings])
        return replace(scenario, seed=seed, controller=replace(scenario.controller, name=entry.name))


def choose_cases(cases: Sequence[Case], wanted: Iterable[str]) -> tuple[Case, ...]:
    """Cases by name or shell pattern such as ``latency-*``, in the battery's order; all of them if none is
    named.

    Raises InputError, which lists the names, if a name fits no case.
    """
    chosen: set[str] = set()
    for pattern in wanted:
        fitting = {case.name for case in cases if fnmatchcase(case.name, pattern)}
        if not fitting:
            raise unknown_name("case", pattern, [case.name for case in cases])
        chosen |= fitting
    return tuple(case for case in cases if case.name in chosen or not chosen)


_FLAT = (
    "part.file=plate",
    "plan.pattern=raster",
    "plan.raster_direction=[1.0, 0.0, 0.0]",
    "plan.stepover_m=0.025",
)
_FREEFORM = ("part.file=freeform", "plan.stepover_m=0.016")
_FAR_OFF = "safety.offset_limit_m=0.01"  # an offset the controller has to follow must not stop the run
APPROACH_20 = "process.approach_speed_m_s=0.02"


def _hold(name: str, text: str, *settings: str) -> Case:
    return Case(name, text, "force", settings)


def _real(name: str, text: str, *settings: str) -> Case:
    return _hold(
        f"real-{name}", f"{text}; 20 N, approach 20 mm/s", f"robot.arm={FIRST}", APPROACH_20, *settings
    )


def _flat(name: str, text: str, feed_mm_s: float, seconds: float, *settings: str) -> Case:
    sets = (*_FLAT, f"process.feed_m_s={feed_mm_s / 1e3}", f"process.max_feed_s={seconds}", *settings)
    return Case(name, text, "surface", sets)


def _freeform(name: str, text: str, feed_mm_s: float, *settings: str) -> Case:
    return Case(name, text, "surface", (*_FREEFORM, f"process.feed_m_s={feed_mm_s / 1e3}", *settings))


def spring_settings(scale: float) -> tuple[str, str]:
    """Springs of head and pad, as a multiple of the planned ones; soft ones deflect beyond the allowed part
    offset."""
    return f"head.spring_scale={scale}", f"safety.offset_limit_m={0.03 if scale < 1.0 else 0.005}"


def latency_settings(total_ms: float) -> tuple[str, str]:
    """A total latency, shared between sensor and command as in the default cell."""
    shared = share_latency(total_ms / 1e3)
    return f"sensor.latency_s={shared.sensor}", f"robot.command_latency_s={shared.command}"


BATTERY = (
    _hold("step-10", "10 N on a flat plate, approach 5 mm/s, held 4 s", "process.contact_force_n=10"),
    _hold("step-20", "20 N on a flat plate, approach 5 mm/s, held 4 s"),
    _hold(
        "step-50",
        "50 N on a flat plate, approach 5 mm/s, held 4 s, force limit 80 N",
        "process.contact_force_n=50",
        "safety.force_limit_n=80",
        "pad.friction_smoothing_m_s=0.01",
    ),
    *(
        _hold(
            f"approach-{v}",
            f"20 N on a flat plate, approach {v} mm/s",
            f"process.approach_speed_m_s={v / 1e3}",
        )
        for v in (2, 5, 20)
    ),
    *(
        _flat(f"flat-{v}", f"flat plate, strokes along x 25 mm apart, 20 N at {v} mm/s for {t} s", v, t)
        for v, t in ((10, 30), (30, 12), (100, 6))
    ),
    *(
        _freeform(f"freeform-{v}", f"freeform part, whole spiral with 16 mm step-over, 20 N at {v} mm/s", v)
        for v in (10, 30, 60)
    ),
    _flat(
        "edge-1mm",
        "plate at 30 mm/s, the real one with a 1 mm edge across the strokes",
        30,
        18,
        "part.real_file=plate_step",
    ),
    _flat(
        "ramp-8deg",
        "plate at 30 mm/s, the real one with an 8 deg ramp across the strokes",
        30,
        18,
        "part.real_file=plate_ramp",
        _FAR_OFF,
    ),
    _hold(
        "moving-1hz",
        "20 N on a plate that moves up and down by 0.5 mm at 1 Hz, held 6 s",
        "part.motion_m=0.0005",
        "part.motion_hz=1",
        "process.hold_s=6",
        APPROACH_20,
    ),
    *(
        _hold(
            f"stiffness-{x:g}",
            f"springs of head and pad {x:g} x what the controller takes them for, approach 20 mm/s",
            *spring_settings(x),
            APPROACH_20,
        )
        for x in (0.2, 0.5, 2.0, 5.0)
    ),
    _hold(
        "rigid-block",
        "10 N on a block that hardly gives: springs 10 x, 50 kN/m in all; 2 kHz physics, held 6 s",
        "process.contact_force_n=10",
        "head.spring_scale=10",
        "process.hold_s=6",
        "safety.force_limit_n=80",
        "safety.jump_limit_n=0",
        "simulation.timestep_s=0.0005",
        "simulation.control_every=2",
    ),
    *(
        _hold(
            f"latency-{ms}",
            f"{ms} ms from contact to motion, sensor and command 1:3, approach 20 mm/s",
            *latency_settings(ms),
            APPROACH_20,
        )
        for ms in (2, 4, 12, 20)
    ),
    *(
        _hold(
            f"noise-{n}",
            f"sensor noise {n} N rms per sample, approach 20 mm/s",
            f"sensor.force_noise_n={n}",
            APPROACH_20,
        )
        for n in (0, 1, 2)
    ),
    _freeform(
        "part-3mm",
        "freeform at 30 mm/s, the part 3 mm off its place",
        30,
        "part.displacement_m=0.003",
        _FAR_OFF,
    ),
    _freeform(
        "part-2deg",
        "freeform at 30 mm/s, the part turned by 2 deg",
        30,
        f"part.rotation_rad={math.radians(2.0)}",
        _FAR_OFF,
    ),
    _freeform(
        "payload-20",
        "freeform at 30 mm/s, payload taken for 20% too heavy",
        30,
        "sensor.payload_mass_error=0.2",
    ),
    _hold(
        "spindle-6000",
        "spindle at 6000 rpm, friction 0.3, imbalance G6.3, approach 20 mm/s",
        "spindle.speed_rpm=6000",
        "spindle.imbalance_m_s=0.0063",
        APPROACH_20,
    ),
    _freeform(
        "alias-125hz",
        "freeform at 30 mm/s, sensor at 125 Hz: the spindle's 100 Hz shows as 25 Hz",
        30,
        "sensor.rate_hz=125",
    ),
    _real(
        "stretched",
        "a plate 0.72 m from the robot's axis: the arm stretched, its first mode low",
        "part.pose=[0.0,-0.72,0.05,0.0,0.0,0.0]",
    ),
    _real(
        "near-base",
        "a plate 0.35 m from the robot's axis: the arm folded over it",
        "part.pose=[0.0,-0.35,0.05,0.0,0.0,0.0]",
    ),
    _real(
        "soft-gears",
        "gears half as stiff: the arm's first mode near the crossover",
        "robot.real.stiffness_1_nm_rad=[15500.0,15500.0,15500.0,2350.0,2350.0,2350.0]",
        "robot.real.stiffness_2_nm_rad=[25000.0,25000.0,25000.0,3050.0,3050.0,3050.0]",
        "robot.real.stiffness_3_nm_rad=[28500.0,28500.0,28500.0,3550.0,3550.0,3550.0]",
    ),
    _real("cold-sensor", "the robot's built-in sensor, just switched on", "sensor.model=ur5e-built-in"),
    _real(
        "hiccup",
        "4 ms without the host, three times a second",
        "robot.real.missed_s=0.004",
        "robot.real.missed_every_s=0.3",
    ),
)
"""All cases, in the order they are shown."""
