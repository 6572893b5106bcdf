"""The real surface, learned along the path and fed to the next turn.

A part lies a millimetre off and is bent. Where the force is right the tool's height says where the surface
really is; the neighbouring turn, a step-over away, meets nearly the same error, and the slope of what was
learned is known ahead.
"""

from __future__ import annotations

import math

from polish_sim.control.adaptive.drawing import Ahead, at
from polish_sim.control.adaptive.gains import AdaptiveGains, LearningMemory, NeighbourMemory, NormalMemory
from polish_sim.control.loops import low_pass_step
from polish_sim.control.signals import Measurement, Target
from polish_sim.kernels import kernel

#: Time in which the feed-forward fades in where a neighbour is known and out where it is lost [s]
FADE_S = 0.1


@kernel
def learn(ahead: Ahead, t: Target, offset: float, g: AdaptiveGains, dt: float, state: LearningMemory) -> None:
    """Remember how much deeper than planned the real surface lies at the present place.

    The average lags its length behind: it is stored where it belongs. ``offset`` [m] is the tool beyond the
    target along the planned axis, plus (wanted - measured force) / stiffness, less what was planned, see
    ``planned_surplus``.
    """
    speed = t.speed
    if not t.contact or speed <= 0.0 or ahead.rows.shape[0] < 2:
        state.began = 0.0
        return
    s = t.s
    row = int((s - g.learning_length_m) / ahead.spacing)
    if state.began == 0.0:
        state.average, state.began, state.last_row = offset, s, row
    state.average += min(speed * dt / g.learning_length_m, 1.0) * (offset - state.average)
    # The first stretch after a landing only fills the average.
    if s - state.began < 2.0 * g.learning_length_m:
        state.last_row = row
        return
    for k in range(max(state.last_row + 1, 0), min(row + 1, ahead.rows.shape[0])):
        ahead.rows[k].learned, ahead.rows[k].known = state.average, True
    state.last_row = max(row, state.last_row)


@kernel
def learned_rate(
    ahead: Ahead, t: Target, look_ahead: float, g: AdaptiveGains, dt: float, state: NeighbourMemory
) -> float:
    """Velocity along the tool axis that the neighbouring turn says will be needed ``look_ahead`` [s] from now
    [m/s].

    A cycle ``dt`` of 0 leaves the fading as it is.
    """
    speed = t.speed
    n = ahead.rows.shape[0]
    if not g.learning or n < 2 or not t.contact:
        state.fading = 0.0
        return 0.0
    s, h = t.s + speed * look_ahead, g.learning_length_m
    before, after = _neighbour(ahead, s - h), _neighbour(ahead, s + h)
    span = abs(after - before) * ahead.spacing
    found = before >= 0 and after >= 0 and h < span < 4.0 * h
    found = found and ahead.rows[max(before, 0)].known and ahead.rows[max(after, 0)].known
    if found:
        state.slope = (ahead.rows[after].learned - ahead.rows[before].learned) / (2.0 * h)
    state.fading += min(dt / FADE_S, 1.0) * (found - state.fading)
    return g.learning_gain * state.fading * state.slope * speed


@kernel
def _neighbour(ahead: Ahead, s: float) -> int:
    """Row of the neighbour of the place at ``s`` [m], -1 for none."""
    row = int(s / ahead.spacing + 0.5)
    if row < 0 or row >= ahead.rows.shape[0]:
        return -1
    return ahead.rows[row].neighbour


# The real surface's normal, from the moment of the pad's pressure.
#
# A pad that stands aslant presses with one side: the moment about the middle of its face, by the stiffness
# against tilting that the drawing promises at this place, is the angle. Friction acts in the face and has no
# part in it, once the measured moment is moved from the tool point to the face. What moment a border or a
# bend causes on the drawing is taken off, so that the tool does not roll over an edge.


MOMENT_HZ = 3.0
"""Low-pass on the moment [Hz]: the tool swings sideways on the arm's gears, and its inertia is in the
moment."""


@kernel
def level_by_moment(
    ahead: Ahead, m: Measurement, t: Target, g: AdaptiveGains, dt: float, state: NormalMemory
) -> None:
    """Move the correction of the planned axis on by one cycle."""
    if not g.normal or not t.contact or m.wrench[2] < 0.25 * t.force:
        state.rate_x = state.rate_y = 0.0
        if not t.contact:
            state.tilt_x = state.tilt_y = state.moment_x = state.moment_y = 0.0
        return
    # From the tool point to the pad's face, which the head's spring has pushed back.
    travel = m.wrench[2] / g.head_stiffness_n_m
    moment_x = m.wrench[3] - travel * m.wrench[1]
    moment_y = m.wrench[4] + travel * m.wrench[0]
    s, carried = t.s, m.wrench[2] / t.force
    moment_x -= carried * at(ahead.rows.moment_x, ahead.spacing, s)
    moment_y -= carried * at(ahead.rows.moment_y, ahead.spacing, s)
    stiff_x, stiff_y = at(ahead.rows.tilt_x, ahead.spacing, s), at(ahead.rows.tilt_y, ahead.spacing, s)
    if ahead.rows.shape[0] < 2:
        stiff_x = stiff_y = g.pad_tilt_stiffness_nm_rad
    state.moment_x = low_pass_step(state.moment_x, moment_x, MOMENT_HZ, dt)
    state.moment_y = low_pass_step(state.moment_y, moment_y, MOMENT_HZ, dt)
    state.rate_x = _rate(state.moment_x, stiff_x, g)
    state.rate_y = _rate(state.moment_y, stiff_y, g)
    state.tilt_x += state.rate_x * dt
    state.tilt_y += state.rate_y * dt
    size = math.sqrt(state.tilt_x * state.tilt_x + state.tilt_y * state.tilt_y)
    if size > g.normal_limit_rad:
        state.tilt_x *= g.normal_limit_rad / size
        state.tilt_y *= g.normal_limit_rad / size


@kernel
def _rate(moment: float, stiffness: float, g: AdaptiveGains) -> float:
    """Rate of the correction [rad/s]; slower where only a part of the pad touches and the moment says
    less."""
    whole = max(stiffness / g.pad_tilt_stiffness_nm_rad, 1e-3)
    rate = -g.normal_rate_1_s * whole * moment / g.pad_tilt_stiffness_nm_rad
    return min(max(rate, -g.normal_turning_rad_s), g.normal_turning_rad_s)
