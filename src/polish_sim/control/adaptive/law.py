"""The composition: position, orientation and moment as in ``hybrid-pi``, tool z by the adaptive laws.

Context: [its length | gains: hybrid | laws along z | laws of the path | memory: hybrid | along z | of the path | what
lies ahead on the path].
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import carray
from numpy.typing import NDArray

from polish_sim.config import ControllerConfig
from polish_sim.control.adaptive.drawing import (
    Ahead,
    ahead_of,
    followable_share,
    forget,
    granted_feed,
    lead_turning,
    no_ahead,
    pack_ahead,
    planned_press_rate,
    planned_surplus,
)
from polish_sim.control.adaptive.force_loop import (
    as_sensed,
    begin_contact,
    change_stiffness,
    expect_delay,
    measure_delay,
    observe_force,
    pace_of,
    remember_command,
    under_way,
)
from polish_sim.control.adaptive.gains import (
    AGE,
    AIR_VARIANCE,
    APPROACH_SPEED,
    AT_NO_TRAVEL,
    DELAY,
    FAST,
    GAINS_SIZE,
    LANDED,
    LAST_COMMAND,
    MEMORY_SIZE,
    PATH_GAINS_SIZE,
    PATH_MEMORY_SIZE,
    RATE,
    STIFFNESS,
    TOLD,
    TOUCHES,
    TRAVEL,
    WATCHED,
    AdaptiveGains,
    PathGains,
    PathMemory,
    PressMemory,
    abilities,
    adaptive_gains,
    gains_in,
    memory_in,
    path_gains,
    path_gains_in,
    path_memory_in,
)
from polish_sim.control.adaptive.landing import (
    fell_back,
    is_armed,
    note_landing,
    own_force,
    quickest_stop,
    refine_stiffness,
    restart_fit,
    seek_speed,
    smooth_reading,
    speed_limit,
    watch_air,
)
from polish_sim.control.adaptive.surface import learn, learned_rate, level_by_moment, tilted_target
from polish_sim.control.hybrid import GAINS_SIZE as HYBRID_GAINS
from polish_sim.control.hybrid import (
    STATE_SIZE,
    HybridState,
    gains_of,
    hybrid_state_of,
    orientation_gains,
    position_by_velocity,
    position_gains,
    replace_along_z,
    turn_and_level,
    turn_to_target,
)
from polish_sim.control.signals import (
    ANSWER_SIZE,
    LAW_SIGNATURE,
    MEASUREMENT_SIZE,
    TARGET_SIZE,
    CompiledController,
    Course,
    Measurement,
    Target,
    measurement_of,
    target_of,
)
from polish_sim.kernel_cache import cfunc, njit

Array = NDArray[np.float64]

LAWS_AT = 1 + HYBRID_GAINS
PATH_GAINS_AT = LAWS_AT + GAINS_SIZE
HYBRID_AT = PATH_GAINS_AT + PATH_GAINS_SIZE
MEMORY_AT = HYBRID_AT + STATE_SIZE
PATH_AT = MEMORY_AT + MEMORY_SIZE
AHEAD_AT = PATH_AT + PATH_MEMORY_SIZE

_LANDING = 0.3  # until the landing is over by this much, stiffness is learned


@njit(cache=True)
def step_hybrid_adaptive(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Controller ``hybrid-adaptive``."""
    h, dt = context[1:], m.clock[1]
    g, memory = gains_in(context[LAWS_AT:]), memory_in(context[MEMORY_AT:])
    hybrid = hybrid_state_of(context[HYBRID_AT:])
    ahead, path = ahead_of(context[AHEAD_AT:]), path_memory_in(context[PATH_AT:])
    p = path_gains_in(context[PATH_GAINS_AT:])
    position_by_velocity(m, t, position_gains(h), dt, hybrid, twist)
    turn(h, p, ahead, path, m, t, hybrid, dt, twist)
    by_position = along_z(m, twist)
    ratio = g.stiffness / memory.force[STIFFNESS] if memory.force[STIFFNESS] > 0.0 else 1.0
    expected = expected_rate(p, ahead, path, m, t, 0.0, ratio, dt)
    expected_then = expected_rate(p, ahead, path, m, t, memory.delay[DELAY], ratio, 0.0)
    speed = press(g, memory, m, t, by_position, expected, expected_then, dt)
    replace_along_z(m, speed, twist)
    remember_command(memory, speed)
    look_back(p, memory, ahead, path, m, t, ratio, dt, twist)


@njit(cache=True)
def turn(
    h: Array, p: PathGains, ahead: Ahead, path: PathMemory, m: Measurement, t: Target, hybrid: HybridState, dt: float,
    twist: Array,
) -> None:  # fmt: skip
    """Angular part of the twist: to the planned axis, corrected by what the pad's moment says of the surface."""
    level_by_moment(ahead, m, t, p.normal, dt, path.normal)
    tilted_target(t, path.normal, path.wanted)
    if p.normal.weight > 0.0:
        corrected = Target(t.position, path.wanted, t.twist, t.force, t.contact, t.path)
        turn_to_target(m, corrected, orientation_gains(h), dt, path.nothing, hybrid, twist)
    else:
        turn_and_level(h, dt, m, t, hybrid, twist)
    lead_turning(ahead, t, p.forward, twist)


@njit(cache=True)
def expected_rate(
    p: PathGains, ahead: Ahead, path: PathMemory, m: Measurement, t: Target, look_ahead: float, ratio: float, dt: float
) -> float:
    """Speed along tool z that drawing and neighbour turn say the path asks for ``look_ahead`` [s] from now [m/s]."""
    planned = planned_press_rate(ahead, m, t, path.wanted, look_ahead, ratio, p.forward)
    return planned + learned_rate(ahead, t, look_ahead, p.learning, dt, path.neighbour)


@njit(cache=True)
def look_back(
    p: PathGains, memory: PressMemory, ahead: Ahead, path: PathMemory, m: Measurement, t: Target,
    ratio: float, dt: float, twist: Array,
) -> None:  # fmt: skip
    """What the force now believed in teaches: where the surface is, and how fast to feed."""
    state = memory.force
    if memory.air[TOUCHES] == 0.0 or state[STIFFNESS] == 0.0:
        twist[6] = 1.0
        return
    error = t.force[0] - (state[AT_NO_TRAVEL] + state[STIFFNESS] * state[TRAVEL])
    height = 0.0
    for i in range(3):
        height += t.rotation[i, 2] * (m.position[i] - t.position[i])
    offset = height + error / state[STIFFNESS] - planned_surplus(ahead, t, ratio, p.forward)
    learn(ahead, t, offset, p.learning, dt, path.learning)
    twist[6] = granted_feed(ahead, t, error, p.feed, dt, path.feed)


@njit(cache=True)
def along_z(m: Measurement, twist: Array) -> float:
    """Speed along tool z [m/s]."""
    z = m.rotation[:, 2]
    return float(z[0] * twist[0] + z[1] * twist[1] + z[2] * twist[2])


@njit(cache=True)
def press(
    g: AdaptiveGains,
    memory: PressMemory,
    m: Measurement,
    t: Target,
    by_position: float,
    expected: float,
    expected_then: float,
    dt: float,
) -> float:
    """Speed along tool z [m/s]: the laws along z in turn.

    Args:
        g: Gains.
        memory: Memory.
        m: Measurement.
        t: Target.
        by_position: Speed the position law asks for, the answer in the air [m/s].
        expected: Speed along z that the path asks for at this moment to keep the force [m/s].
        expected_then: The same when today's command acts [m/s].
        dt: Control cycle [s].
    """
    expect_delay(g, memory)
    speed = along_z(m, m.twist)
    pressing = speed - expected
    memory.force[TRAVEL] += pressing * dt
    own = own_force(g, memory, m, speed, pressing if memory.air[TOUCHES] > 0.0 else 0.0, dt)
    seen = as_sensed(g, memory, memory.force[TRAVEL], own, dt)
    reading = m.wrench[2] - seen.own
    if not _touches(g, memory, t, along_z(m, t.twist), seen.path, reading, dt):
        measure_delay(g, memory, speed, dt)
        return by_position if t.contact[0] == 0.0 else seek_speed(memory)
    state = memory.force
    state[AGE] += dt
    if g.estimates > 0.0 and state[LANDED] < _LANDING:
        stiffness = refine_stiffness(g, memory, g.stiffness, seen.path, reading, pressing, dt)
        change_stiffness(memory, stiffness, seen.path)
    pace = pace_of(g, state[STIFFNESS], memory.delay[DELAY], np.sqrt(memory.air[AIR_VARIANCE]), state[AGE])
    force = observe_force(memory, pace.observer, seen.path, reading, state[LANDED], dt)
    rate = state[LANDED] * state[RATE]
    # What the path will have asked for until then is no travel into the part.
    asked = 0.5 * (expected + expected_then) * memory.delay[DELAY]
    travel = (t.force[0] - force) / state[STIFFNESS] - (under_way(memory, dt) - asked)
    wanted = quickest_stop(g, travel, pace.crossover, speed_limit(g, memory, state[STIFFNESS]))
    note_landing(g, memory, wanted, dt)
    wanted += expected_then - rate / state[STIFFNESS]
    step = g.acceleration * dt
    return min(max(wanted, memory.delay[LAST_COMMAND] - step), memory.delay[LAST_COMMAND] + step)


@njit(cache=True)
def _touches(
    g: AdaptiveGains, memory: PressMemory, t: Target, planned: float, path: float, reading: float, dt: float
) -> bool:
    """Whether the tool touches: by the target's word, by its own, and by noise only until the reading falls back."""
    air, controlled = memory.air, t.contact[0] > 0.0
    if air[TOLD] > 0.0 and not controlled:
        air[WATCHED], air[TOUCHES] = 0.0, 0.0
    air[TOLD] = t.contact[0]
    if g.touch_down == 0.0:
        first = controlled and air[TOUCHES] == 0.0
        air[TOUCHES] = t.contact[0]
    elif air[TOUCHES] > 0.0:
        smooth_reading(memory, reading, dt)
        air[TOUCHES] = 0.0 if fell_back(memory) else 1.0
        first = False
    else:
        if not controlled:
            air[APPROACH_SPEED] = max(air[APPROACH_SPEED], planned)
        noticed = watch_air(memory, reading, planned > 1e-5 or controlled, dt)
        first = noticed or (controlled and not is_armed(memory))
        air[TOUCHES] = 1.0 if first else 0.0
    if first:
        force = max(air[FAST], 0.0) if g.touch_down > 0.0 else reading
        begin_contact(memory, g.stiffness * (g.stiff_first if g.estimates > 0.0 else 1.0), path, force)
        restart_fit(memory, path, force)
    return bool(air[TOUCHES] > 0.0)


@cache
def hybrid_adaptive_law() -> Any:
    """Compiled entry of ``hybrid-adaptive``, made at first use."""

    @cfunc(LAW_SIGNATURE)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        length = int(carray(context, 1)[0])
        step_hybrid_adaptive(carray(context, length), m, t, carray(twist, ANSWER_SIZE))

    return law


# ``hybrid-adaptive`` as the cell and Python call it.


class AdaptiveController(CompiledController):
    """The composed laws, and what lies ahead behind their memory.

    Args:
        config: Gains and the laws that are on.

    Raises:
        ConfigError: If it names a law that does not exist.
    """

    def __init__(self, config: ControllerConfig) -> None:
        laws = config.adaptive
        gains = np.concatenate([[0.0], gains_of(config), adaptive_gains(laws), path_gains(laws)])
        super().__init__(gains, AHEAD_AT - HYBRID_AT, step_hybrid_adaptive, hybrid_adaptive_law)
        self._abilities = abilities(laws)
        self._lay_out(no_ahead())

    def prepare(self, course: Course) -> None:
        """Take in what lies ahead on the path."""
        self._lay_out(pack_ahead(course, followable_share(course, self._abilities)))

    def reset(self, cycle_s: float) -> None:
        """Forget everything but what lies ahead."""
        self.context[HYBRID_AT:AHEAD_AT] = 0.0
        forget(self.context[AHEAD_AT:])

    def _lay_out(self, ahead: Array) -> None:
        self.context = np.concatenate([self.context[:AHEAD_AT], ahead])
        self.context[0] = len(self.context)


def hybrid_adaptive(config: ControllerConfig) -> AdaptiveController:
    """The controller for a real polishing cell, of laws that `controller.adaptive.laws` can leave out one by one.

    Raises:
        ConfigError: If it names a law that does not exist.
    """
    return AdaptiveController(config)
