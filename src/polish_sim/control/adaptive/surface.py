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
    if not t.contact or speed <= 0.0:
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
    if not g.learning or not t.contact:
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
        if not t.contact:
            for k in range(2):
                state.tilt[k] = state.moment[k] = 0.0
        return
    # From the tool point to the pad's face, which the head's spring has pushed back.
    travel, carried = m.wrench[2] / g.head_stiffness_n_m, m.wrench[2] / t.force
    moment = m.wrench[3] - travel * m.wrench[1], m.wrench[4] + travel * m.wrench[0]
    usual, rows = g.pad_tilt_stiffness_nm_rad, ahead.rows
    for k in range(2):
        own = moment[k] - carried * at(rows.moment[:, k], ahead.spacing, t.s)
        state.moment[k] = low_pass_step(state.moment[k], own, MOMENT_HZ, dt)
        stiffness = usual if rows.shape[0] < 2 else at(rows.tilt_stiffness[:, k], ahead.spacing, t.s)
        # Slower where only a part of the pad touches and the moment says less.
        # Downhill on (own / doubt)^2 + (tilt / lean)^2, the second linear beyond the usual lean: what sensor
        # and drawing are wrong by does not turn the tool further than parts lean.
        seen = max(stiffness / usual, 1e-3) * state.moment[k] / usual
        likely = min(max(state.tilt[k], -g.normal_lean_rad), g.normal_lean_rad)
        rate = -g.normal_rate_1_s * (seen + (g.normal_doubt_nm / (usual * g.normal_lean_rad)) ** 2 * likely)
        state.tilt[k] += min(max(rate, -g.normal_turning_rad_s), g.normal_turning_rad_s) * dt
    size = math.sqrt(state.tilt[0] * state.tilt[0] + state.tilt[1] * state.tilt[1])
    if size > g.normal_limit_rad:
        for k in range(2):
            state.tilt[k] *= g.normal_limit_rad / size
