"""The composition: position, orientation and moment as in ``hybrid-pi``, tool z by the adaptive laws."""

from __future__ import annotations

import math

import numpy as np
from numba import carray

from polish_sim.arrays import Array
from polish_sim.config import ControllerConfig
from polish_sim.control.adaptive import drawing, force_loop, landing
from polish_sim.control.adaptive.drawing import Ahead
from polish_sim.control.adaptive.gains import AdaptiveGains, PathMemory, PressMemory, adaptive_gains
from polish_sim.control.adaptive.surface import learn, learned_rate, level_by_moment
from polish_sim.control.hybrid import (
    HybridGains,
    HybridMemory,
    along_z,
    hybrid_gains,
    position_by_velocity,
    replace_along_z,
    turn_and_level,
    turn_to_target,
)
from polish_sim.control.loops import strike_limit
from polish_sim.control.signals import (
    LAW_SIGNATURE,
    CompiledController,
    Course,
    Measurement,
    Target,
    records_at,
)
from polish_sim.kernel_cache import cfunc
from polish_sim.kernels import Record, dot, kernel, minus
from polish_sim.spatial import tilt_frame

_LANDING = 0.3  # until the landing is over by this much, stiffness is learned with the feed on too


class AdaptiveMemory(Record):
    """All zero after a reset."""

    hybrid: HybridMemory
    press: PressMemory
    path: PathMemory


class AdaptiveContext(Record):
    """What the law reads and writes besides the course."""

    hybrid: HybridGains
    gains: AdaptiveGains
    spacing: float  #: Of the course's rows [m]
    rows: int  #: Of the course; 0 without one
    memory: AdaptiveMemory


_CONTEXT, _ROW = AdaptiveContext.dtype, drawing.AheadRow.dtype


@cfunc(LAW_SIGNATURE)
def _hybrid_adaptive_law(context, course, measurement, target, answer):  # type: ignore[no-untyped-def]
    c, m, t, out = records_at(context, _CONTEXT, measurement, target, answer)
    ahead = Ahead(c.spacing, carray(course, c.rows, _ROW))
    g, memory, path, twist = c.gains, c.memory.press, c.memory.path, out.twist
    position_by_velocity(m, t, c.hybrid.position, c.memory.hybrid, twist)
    turn(c.hybrid, g, ahead, path, m, t, c.memory.hybrid, twist)
    by_position = along_z(m, twist)
    ratio = g.stiffness_n_m / memory.force.stiffness if memory.force.stiffness > 0.0 else 1.0
    expected = expected_rate(g, ahead, path, m, t, 0.0, ratio, m.cycle)
    expected_then = expected_rate(g, ahead, path, m, t, memory.delay.delay, ratio, 0.0)
    arm_mode = drawing.at(ahead.rows.arm_mode, ahead.spacing, t.s) if c.rows > 1 else g.arm_mode
    speed = press_adaptive(g, memory, m, t, by_position, expected, expected_then, arm_mode)
    replace_along_z(m, speed, twist)
    force_loop.remember_command(memory, speed)
    out.feed = look_back(g, memory, ahead, path, m, t, ratio)


@kernel
def turn(
    h: HybridGains,
    g: AdaptiveGains,
    ahead: Ahead,
    path: PathMemory,
    m: Measurement,
    t: Target,
    hybrid: HybridMemory,
    twist: Array,
) -> None:
    """Angular part of the twist: to the planned axis, corrected by the surface's normal from the pad's
    moment."""
    level_by_moment(ahead, m, t, g, m.cycle, path.normal)
    tilt_frame(t.rotation, path.normal.tilt[0], path.normal.tilt[1], path.wanted)
    if g.normal:
        turn_to_target(m, path.wanted, t.twist, h.orientation, False, hybrid, twist)
    else:
        turn_and_level(m, t, h, hybrid, twist)
    drawing.lead_turning(ahead, t, g, twist)


@kernel
def expected_rate(
    g: AdaptiveGains,
    ahead: Ahead,
    path: PathMemory,
    m: Measurement,
    t: Target,
    look_ahead: float,
    ratio: float,
    dt: float,
) -> float:
    """Speed along tool z that drawing and neighbour turn say the path asks for ``look_ahead`` [s] from now
    [m/s]."""
    planned = drawing.planned_press_rate(ahead, m, t, path.wanted, look_ahead, ratio, g)
    return planned + learned_rate(ahead, t, look_ahead, g, dt, path.neighbour)


@kernel
def look_back(
    g: AdaptiveGains,
    memory: PressMemory,
    ahead: Ahead,
    path: PathMemory,
    m: Measurement,
    t: Target,
    ratio: float,
) -> float:
    """Learn from the observed force where the surface is; share of the planned feed to grant [-]."""
    state = memory.force
    if not memory.air.touches or state.stiffness == 0.0:
        return 1.0
    error = t.force - (state.at_no_travel + state.stiffness * state.travel)
    height = dot(t.rotation[:, 2], minus(m.position, t.position))
    offset = height + error / state.stiffness - drawing.planned_surplus(ahead, t, ratio, g)
    learn(ahead, t, offset, g, m.cycle, path.learning)
    path.feed_error = drawing.averaged_error(path.feed_error, error, t, m.cycle)
    return drawing.granted_feed(ahead, t, path.feed_error, g)


@kernel
def press_adaptive(
    g: AdaptiveGains,
    memory: PressMemory,
    m: Measurement,
    t: Target,
    by_position: float,
    expected: float,
    expected_then: float,
    arm_mode: float,
) -> float:
    """Speed along tool z [m/s]: the laws along z in turn.

    ``by_position`` is what the position law asks for, the answer in the air; ``expected`` is the speed the
    path asks for at this moment to keep the force, ``expected_then`` the same when today's command acts
    [m/s]; ``arm_mode`` is the arm's vibration [rad/s].
    """
    dt = m.cycle
    if memory.delay.delay == 0.0:
        memory.delay.delay = g.command_delay_s  # believed until one has been measured
    speed = along_z(m, m.twist)
    pressing = speed - expected
    memory.force.travel += pressing * dt
    own = landing.own_force(g, memory, m, speed, pressing if memory.air.touches else 0.0, dt)
    seen = force_loop.as_sensed(g, memory, memory.force.travel, own, dt)
    reading = m.wrench[2] - seen.own
    planned = along_z(m, t.twist)
    if not _touches(g, memory, t, planned, seen.path, reading, dt):
        force_loop.measure_delay(g, memory, speed, dt)
        # Held up on the part and let down again, the tool is far behind its target.
        return landing.seek_speed(memory) if t.contact else min(by_position, planned + landing.SEEK_SLOWEST)
    state = memory.force
    state.age += dt
    if g.stiffness and (state.landed < _LANDING or (t.speed == 0.0 and not memory.fit.reached)):
        stiffness = landing.refine_stiffness(g, memory, seen.path, reading, pressing)
        force_loop.change_stiffness(memory, stiffness, seen.path)
    pace = force_loop.pace_of(
        g, state.stiffness, memory.delay.delay, math.sqrt(memory.air.variance), state.age
    )
    force_loop.observe_force(memory, pace, seen.path, reading, dt)
    force = state.stiffness * state.travel + force_loop.correction(memory, arm_mode, pace.crossover, dt)
    # A reading that swings is beyond it before the travel has said anything of the springs.
    memory.fit.reached |= force >= t.force and state.stiffness < 0.5 * g.stiff_first * g.stiffness_n_m
    # What the path will have asked for until then is no travel into the part.
    asked = 0.5 * (expected + expected_then) * memory.delay.delay
    coming = force_loop.under_way(memory, dt) - asked
    travel = (t.force - force) / state.stiffness - coming
    wanted = landing.quickest_stop(g, travel, pace.crossover, landing.speed_limit(g, memory))
    wanted = min(wanted, strike_limit(g.strike, t.force, reading, state.travel - seen.path + coming))
    landing.note_landing(g, memory, wanted, dt)
    wanted += expected_then
    step = g.acceleration_m_s2 * dt
    return min(max(wanted, memory.delay.last_command - step), memory.delay.last_command + step)


@kernel
def _touches(
    g: AdaptiveGains, memory: PressMemory, t: Target, planned: float, path: float, reading: float, dt: float
) -> bool:
    """Whether the tool touches: as the target says or the reading shows; noise counts only until it falls
    back."""
    air, controlled = memory.air, t.contact
    if air.target_contact and not controlled:
        air.watched, air.touches = 0.0, False
    air.target_contact = controlled
    before = air.touches
    if not g.touch_down:
        air.touches = controlled
    elif before:
        landing.smooth_reading(memory, reading, dt)
        air.touches = not landing.fell_back(memory)
    else:
        if not controlled:
            air.approach_speed = max(air.approach_speed, planned)
        air.touches = landing.watch_air(memory, reading, planned, controlled, dt)
        air.touches |= controlled and not landing.is_armed(memory)
    if air.touches and not before:
        force = max(air.fast, 0.0) if g.touch_down else reading
        force_loop.begin_contact(
            memory, g.stiffness_n_m * (g.stiff_first if g.stiffness else 1.0), path, force
        )
        landing.restart_fit(memory, path, force)
    return air.touches


# ``hybrid-adaptive`` as the cell and Python call it.


class AdaptiveController(CompiledController):
    """The composed laws, and what lies ahead on the path."""

    def __init__(self, config: ControllerConfig) -> None:
        laws = config.adaptive
        context = AdaptiveContext(hybrid_gains(config), adaptive_gains(laws), spacing=1.0)
        super().__init__(context, _hybrid_adaptive_law, np.zeros(1, drawing.AheadRow.dtype))
        self._laws = laws

    def prepare(self, course: Course) -> None:
        """Take in what lies ahead on the path, and how the arm swings there, or is believed to."""
        believed = self.context.gains.arm_mode
        modes = np.where(course.arm_mode > 0.0, course.arm_mode, believed) * (believed > 0.0)
        course = course._replace(arm_mode=modes)
        self.course = drawing.rows_ahead(course, drawing.followable_share(course, self._laws))
        self.context.spacing, self.context.rows = course.spacing, len(self.course)

    def reset(self, cycle_s: float) -> None:
        """Forget everything but what lies ahead."""
        super().reset(cycle_s)
        self.course["learned"], self.course["known"] = 0.0, False


def hybrid_adaptive(config: ControllerConfig) -> AdaptiveController:
    """For a real polishing cell: laws that `controller.adaptive.laws` can leave out one by one."""
    return AdaptiveController(config)
