"""Controller ``admittance``: a virtual mass and damper driven by the force error, M dv/dt + D v = Fd - Fe (layer 7).

The law of most cobot force modes and of ROS's compliance controllers. Its gains follow from the nominal cell:
M is twice the mass the wrist sensor feels (the felt inertia then has a loop gain of at most 1/2), D damps M critically
on the nominal springs, D = 2 sqrt(k M). No spring: on a resting part the error goes to zero, on a ramp of normal speed
u the error D u stays.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import carray, cfunc, njit
from numpy.typing import NDArray

from polish_sim.config import ControllerConfig
from polish_sim.control.baselines.virtual_mass import (
    BASELINE_SIZE,
    MEMORY,
    STARTED,
    VELOCITY,
    VirtualMass,
    baseline_gains,
    move_around,
    own_memory,
    push,
    speed_along_z,
    virtual_mass,
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


@njit(cache=True)
def step_admittance(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Controller ``admittance``; until contact the tool moves by position."""
    move_around(context, m, t, twist)
    memory = own_memory(context)
    if t.contact[0] == 0.0:
        memory[STARTED] = 0.0
        return
    if memory[STARTED] == 0.0:
        memory[STARTED], memory[VELOCITY] = 1.0, speed_along_z(m)
    rate = push(virtual_mass(context), t.force[0] - m.wrench[2], m.clock[1], memory)
    replace_along_z(m, rate, twist)


@cache
def admittance_law() -> Any:
    """Compiled entry of ``admittance``, made at first use."""

    @cfunc(LAW_SIGNATURE, cache=True)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_admittance(carray(context, BASELINE_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


def admittance(config: ControllerConfig) -> CompiledController:
    """Admittance control along tool z."""
    body = VirtualMass(config.baselines.mass_kg, config.baselines.damping_n_s_m, 0.0, config.force_limit_m_s)
    return CompiledController(baseline_gains(config, body), MEMORY, step_admittance, admittance_law)
