"""Controller ``force-mode``: behaves like a UR robot's own force mode, as far as that is public (layer 7).

Public (manual of URScript, documentation of the ROS driver): the mode runs in the robot at 500 Hz; compliant axes are
chosen by a selection vector and limited in speed; a damping from 0 (keeps its speed where nothing presses) to 1
(comes to rest at once), by default 0.025; a gain scaling from 0 to 2, by default 0.5, which above 1 may be unstable
on hard surfaces. A law that keeps its speed is a mass pushed by the force error, so this one is

    v <- (1 - damping) v + scaling / M (Fd - Fe) h        every h = 2 ms.

Ours, not public: that the damping counts per step; M, the mass at a scaling of 1, taken as what the arm itself weighs
along the tool axis (lighter than itself an arm cannot be made to feel without feeding energy in, which fits the
warning about scalings above 1); the mean of the readings since the last step as its filter. The real mode has no
latency of a host between itself and the servos; here it answers through the same speedl as all others.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import carray, cfunc, njit
from numpy.typing import NDArray

from polish_sim.config import ControllerConfig
from polish_sim.control.baselines.virtual_mass import (
    BASELINE_SIZE,
    MEMORY,
    STARTED,
    VELOCITY,
    baseline_gains,
    move_around,
    own_gains,
    own_memory,
    speed_along_z,
)
from polish_sim.control.compiled import LAW_SIGNATURE, CompiledController
from polish_sim.control.hybrid import replace_along_z
from polish_sim.control.signals import (
    ANSWER_SIZE,
    MEASUREMENT_SIZE,
    TARGET_SIZE,
    Measurement,
    Target,
    measurement_of,
    target_of,
)

Array = NDArray[np.float64]

STEP_S = 0.002
"""The mode's own cycle [s]."""
PASSED, SUM, READINGS = 3, 4, 5


class ModeGains(NamedTuple):
    """What the mode is told."""

    mass: float
    """Virtual mass M / scaling [kg]."""
    damping: float
    """Share of the speed lost per step [-]."""
    limit: float
    """Largest speed [m/s]."""


@njit(cache=True)
def mode_speed(error: float, dt: float, gains: ModeGains, memory: Array) -> float:
    """Speed of the mode, renewed every 2 ms and held in between.

    Args:
        error: Fd - Fe [N].
        dt: Control cycle [s].
        gains: The mode's gains.
        memory: Speed, and what came in since the last step.

    Returns:
        The speed [m/s].
    """
    memory[PASSED] += dt
    memory[SUM] += error
    memory[READINGS] += 1.0
    if memory[PASSED] >= STEP_S - 1e-9:
        push = memory[SUM] / memory[READINGS] * memory[PASSED] / gains.mass
        kept = (1.0 - gains.damping) ** (memory[PASSED] / STEP_S)
        memory[VELOCITY] = min(max(kept * memory[VELOCITY] + push, -gains.limit), gains.limit)
        memory[PASSED] = memory[SUM] = memory[READINGS] = 0.0
    return float(memory[VELOCITY])


@njit(cache=True)
def step_force_mode(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Controller ``force-mode``; until contact the tool moves by position."""
    move_around(context, m, t, twist)
    own, memory = own_gains(context), own_memory(context)
    if t.contact[0] == 0.0:
        memory[STARTED] = 0.0
        return
    if memory[STARTED] == 0.0:
        memory[STARTED], memory[VELOCITY] = 1.0, speed_along_z(m)
        memory[PASSED] = memory[SUM] = memory[READINGS] = 0.0
    gains = ModeGains(own[0], own[1], own[2])
    replace_along_z(m, mode_speed(t.force[0] - m.wrench[2], m.clock[1], gains, memory), twist)


@cache
def force_mode_law() -> Any:
    """Compiled entry of ``force-mode``, made at first use."""

    @cfunc(LAW_SIGNATURE, cache=True)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_force_mode(carray(context, BASELINE_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


def force_mode(config: ControllerConfig) -> CompiledController:
    """A robot's own force mode along tool z."""
    mode = config.baselines
    gains = ModeGains(mode.mode_mass_kg / mode.mode_gain_scaling, mode.mode_damping, config.force_limit_m_s)
    return CompiledController(baseline_gains(config, gains), MEMORY, step_force_mode, force_mode_law)
