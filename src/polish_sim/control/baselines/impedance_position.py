"""Controller ``impedance-position``: position control to the planned depth that gives way like a spring (layer 7).

The offset x from the planned place follows M d2x/dt2 + D dx/dt + K x = Fd - Fe, the position loop follows the plan
with that offset. M and D are those of ``admittance``; K is a fifth of the nominal springs k, so that of the force a
part in the wrong place would cause under position control K / (K + k), a sixth, stays for good.
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
    OFFSET,
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
from polish_sim.control.hybrid_laws import position_gains
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
def step_impedance_position(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Controller ``impedance-position``; until contact the tool moves by position."""
    move_around(context, m, t, twist)
    body, memory, z = virtual_mass(context), own_memory(context), m.rotation[:, 2]
    if t.contact[0] == 0.0:
        memory[STARTED] = 0.0
        return
    planned = short = 0.0
    for i in range(3):
        planned += z[i] * t.twist[i]
        short += z[i] * (t.position[i] - m.position[i])
    if memory[STARTED] == 0.0:
        # Bumpless: where the tool is, as fast as it is.
        memory[STARTED], memory[VELOCITY], memory[OFFSET] = 1.0, speed_along_z(m) - planned, -short
    given_way = push(body, t.force[0] - m.wrench[2], m.clock[1], memory)
    rate = planned + given_way + (short + memory[OFFSET]) / position_gains(context).look_ahead
    replace_along_z(m, min(max(rate, -body.limit), body.limit), twist)


@cache
def impedance_position_law() -> Any:
    """Compiled entry of ``impedance-position``, made at first use."""

    @cfunc(LAW_SIGNATURE, cache=True)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_impedance_position(carray(context, BASELINE_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


def impedance_position(config: ControllerConfig) -> CompiledController:
    """Position-based impedance control along tool z."""
    own = config.baselines
    body = VirtualMass(own.mass_kg, own.damping_n_s_m, own.stiffness_n_m, config.force_limit_m_s)
    return CompiledController(baseline_gains(config, body), MEMORY, step_impedance_position, impedance_position_law)
