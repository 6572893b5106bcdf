"""Zero-force control: torques by which the arm carries itself and follows the hand (paper 3).

    tau = wg (g(q) + tare) + kc fc s(qd) + kv fv qd + alpha M(q) qdd_f

s is tanh(qd / vs). With the start-up assist of an ideal arm the sign of the hand's torque, as a momentum
observer sees it, takes its place at standstill; of elastic joints s is the way each was moved last. qdd_f is
the low-passed difference of the measured speed. Coriolis torques are left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.config import GuideConfig
from polish_sim.control.loops import low_pass_share
from polish_sim.errors import check_name
from polish_sim.kernels import Record, kernel
from polish_sim.motion.serial_chain import ChainModel, chain_torque

ON_S = 0.01  #: Compensation comes within this time when a hand is felt [s]
OFF_S = 0.2  #: And goes within this time when none is [s]


class Belief(NamedTuple):
    """What the controller takes the arm for."""

    chain: ChainModel
    coulomb: Array  #: Coulomb friction [N m], shape (n,)
    viscous: Array  #: Viscous friction [N m s/rad], shape (n,)
    #: Speed at which a joint creeps under its full Coulomb friction before it breaks away [rad/s], (n,)
    creep: Array
    torque_limit: Array  #: Of the motors [N m], shape (n,)
    #: More Coulomb friction by the weight a joint holds, when it moves against it [-], shape (n,)
    driving: Array
    driven: Array  #: When it moves with it [-], shape (n,)


class GuidingGains(NamedTuple):
    """Compensated shares, and the law's filters."""

    gravity: float
    tare: float
    coulomb: float
    viscous: float
    inertia: float  #: alpha; stable while alpha (1 + relative over-estimate of M) < 1
    assist: float
    sign_speed: float  #: vs [rad/s]
    threshold: float  #: Observed torque that counts as a full push, by the joint's Coulomb friction [-]
    onset: float  #: Bandwidth of the slow part of the observed torque, which is no start [rad/s]
    felt: float  #: Observed torque from which a hand is felt, by the joint's Coulomb friction [-]; 0: always
    acceleration_blend: float  #: Weight of a new sample in the low-pass of the acceleration [-]
    observer: float  #: Bandwidth of the momentum observer [rad/s]
    encoder: float  #: Step of the encoders [rad]; 0: exact
    start: float = 0.0  #: Way in which an elastic joint's direction builds up [rad]; 0: rigid


class GuidingMemory(NamedTuple):
    """Memory of the law; every array has shape (n,)."""

    q: Array  #: Encoders' reading [rad]
    qd: Array  #: Its difference [rad/s]
    qdd: Array  #: Low-passed difference of that [rad/s^2]
    external: Array  #: Torque of the hand as observed [N m]
    impulse: Array  #: Integral of the observer [N m s]
    steady: Array  #: Slow part of the observed torque [N m]
    lean: Array  #: Way an elastic joint was moved last, -1 to 1
    grip: Array  #: First entry: how surely a hand is on the tool, 0 to 1
    tare: Array  #: Torque the servos had to give beyond the model while they held the arm [N m]
    weight: Array  #: Gravity torque of the model [N m]
    torque: Array  #: Torque command of the motors [N m]
    part: Array  #: Room for one torque [N m]
    still: Array  #: Zeros


def build_memory(joints: int) -> GuidingMemory:
    """Fresh memory."""
    return GuidingMemory(*(np.zeros(joints) for _ in GuidingMemory._fields))


@kernel
def quantize_encoders(gains: GuidingGains, memory: GuidingMemory, q: Array, dt: float, first: bool) -> None:
    """Quantise positions [rad], difference them to speeds, these to filtered accelerations; ``first``: none
    before."""
    for j in range(memory.q.shape[0]):
        read = gains.encoder * math.floor(q[j] / gains.encoder + 0.5) if gains.encoder > 0.0 else q[j]
        qd = 0.0 if first else (read - memory.q[j]) / dt
        rate = 0.0 if first else (qd - memory.qd[j]) / dt
        memory.qdd[j] += gains.acceleration_blend * (rate - memory.qdd[j])
        memory.q[j] = read
        memory.qd[j] = qd


@kernel
def guide_by_hand(
    belief: Belief, gains: GuidingGains, memory: GuidingMemory, share: float, dt: float
) -> None:
    """One step of the law: q, qd and qdd of the memory are read, everything else in it is written.

    ``share``: of the compensation that is granted: 1, less near the speed limits.
    """
    chain_torque(belief.chain, memory.q, memory.still, memory.still, 1.0, memory.weight)
    if gains.assist > 0.0:
        _observe(belief, gains, memory, dt)
        share *= _feel(belief, gains, memory, dt)
    chain_torque(belief.chain, memory.q, memory.still, memory.qdd, 0.0, memory.part)
    for j in range(memory.q.shape[0]):
        qd = memory.qd[j]
        lean = math.tanh(qd / gains.sign_speed)
        if gains.start > 0.0:
            lean = min(max(memory.lean[j] + dt * qd / gains.start, -1.0), 1.0)
            memory.lean[j] = lean
        dry = dry_friction(belief, memory, j, lean)
        eased = gains.coulomb * dry * lean
        if gains.assist > 0.0 and gains.start == 0.0:
            at_rest = math.exp(-((qd / gains.sign_speed) ** 2))
            eased += at_rest * (gains.assist * dry * _onset(belief, gains, memory, j) - eased)
        eased += gains.viscous * belief.viscous[j] * qd + gains.inertia * memory.part[j]
        wanted = gains.gravity * (memory.weight[j] + gains.tare * memory.tare[j]) + share * eased
        memory.torque[j] = min(max(wanted, -belief.torque_limit[j]), belief.torque_limit[j])


@kernel
def dry_friction(belief: Belief, memory: GuidingMemory, j: int, qd: float) -> float:
    """Coulomb friction of joint ``j`` at a speed [rad/s] under the weight it holds [N m]."""
    load = belief.driving[j] if memory.weight[j] * qd > 0.0 else belief.driven[j]
    return belief.coulomb[j] + load * abs(memory.weight[j])


@kernel
def _observe(belief: Belief, gains: GuidingGains, memory: GuidingMemory, dt: float) -> None:
    """Momentum observer of the hand's torque, from the torque given in the last step.

    r = K (M qd - int (tau - g - tare - friction + r) dt). Friction of a joint that creeps is taken as steep
    viscous
    friction: its pre-sliding motion is how the observer detects the hand at standstill.
    """
    chain_torque(belief.chain, memory.q, memory.still, memory.qd, 0.0, memory.part)
    for j in range(memory.q.shape[0]):
        qd = memory.qd[j]
        held = (
            dry_friction(belief, memory, j, qd) * min(max(qd / belief.creep[j], -1.0), 1.0)
            + belief.viscous[j] * qd
        )
        given = memory.torque[j] - memory.weight[j] - gains.tare * memory.tare[j] - held
        memory.impulse[j] += dt * (given + memory.external[j])
        memory.external[j] = gains.observer * (memory.part[j] - memory.impulse[j])
        memory.steady[j] += gains.onset * dt * (memory.external[j] - memory.steady[j])


@kernel
def _onset(belief: Belief, gains: GuidingGains, memory: GuidingMemory, j: int) -> float:
    """Sign and size, -1 to 1, of a push that has just begun: what lasts without motion is no start."""
    rise = memory.external[j] - memory.steady[j]
    if rise * memory.external[j] <= 0.0:
        return 0.0
    return min(max(rise / (gains.threshold * belief.coulomb[j]), -1.0), 1.0)


@kernel
def _feel(belief: Belief, gains: GuidingGains, memory: GuidingMemory, dt: float) -> float:
    """Whether a hand is on the tool, fading: without one friction is left to the joints, and they stop and
    stay.

    An elastic joint that is pushed back has no need of help: its friction brakes it.
    """
    if gains.felt == 0.0:
        return 1.0
    felt = False
    for j in range(memory.q.shape[0]):
        push = memory.external[j]
        felt = (
            felt
            or (push * memory.lean[j] if gains.start > 0.0 else abs(push)) > gains.felt * belief.coulomb[j]
        )
    rate = dt / (ON_S if felt else OFF_S)
    memory.grip[0] = min(memory.grip[0] + rate, 1.0) if felt else max(memory.grip[0] - rate, 0.0)
    return memory.grip[0]


# The modes of hand guiding: shares of compensation, one row a mode.


class Mode(NamedTuple):
    """What a mode compensates: 1 as the scenario says, 0 not at all."""

    gravity: float = 0.0
    friction: float = 0.0
    inertia: float = 0.0
    assist: float = 0.0


MODES: Mapping[str, Mode] = {
    "none": Mode(),  # the hand carries the arm
    "gravity": Mode(1.0),
    "classical": Mode(1.0, 1.0),  # paper 3
    "inertia": Mode(1.0, 1.0, 1.0),  # paper 3, improved
    "assist": Mode(1.0, 1.0, 1.0, 1.0),  # and start-up assist
}


def gains_of(mode: str, guide: GuideConfig, dt: float) -> GuidingGains:
    """The law's gains in a mode of `MODES`, at a control period ``dt`` [s]; InputError for an unknown
    mode."""
    check_name("mode", mode, MODES)
    m = MODES[mode]
    return GuidingGains(
        gravity=m.gravity,
        tare=guide.tare,
        coulomb=m.friction * guide.coulomb_share,
        viscous=m.friction * guide.viscous_share,
        inertia=m.inertia * guide.inertia_share,
        assist=m.assist * guide.assist_share,
        sign_speed=guide.sign_speed_rad_s,
        threshold=guide.assist_threshold,
        onset=1.0 / guide.assist_memory_s,
        felt=m.assist * guide.hand_felt,
        acceleration_blend=low_pass_share(guide.acceleration_filter_hz, dt),
        observer=2.0 * math.pi * guide.observer_hz,
        encoder=guide.encoder_rad,
    )


JOINT_SPEED, TOOL_SPEED, ENERGY, UNSTABLE, TOUCH, JOINT_END = 1, 2, 3, 4, 5, 6
GUARDS: Mapping[int, str] = {
    JOINT_SPEED: "a joint is faster than guide.joint_speed_limit_rad_s: move the hand more slowly",
    TOOL_SPEED: "the tool is faster than guide.tool_speed_limit_m_s: move the hand more slowly",
    ENERGY: "the compensation has lent more energy than guide.energy_limit_j: it drives the arm by itself",
    UNSTABLE: "the simulation is unstable: lower simulation.timestep_s",
    TOUCH: "links touch",
    JOINT_END: "a joint is at its end",
}
"""Reasons of a protective stop, by code."""
#: Share of a speed limit from which compensation fades: the joints' own friction brakes [-]
FADE_FROM = 0.9


class Lent(Record):
    """Energy the compensation has lent [J]."""

    now: float
    most: float  #: Largest value so far


class GuidingLimits(NamedTuple):
    """What is never exceeded for long."""

    joint_speed: float  #: [rad/s]
    tool_speed: float  #: [m/s]
    energy: float  #: [J]
    lent: Lent  #: Memory


@kernel
def fade_out(limits: GuidingLimits, qd: Array, tool_speed: float) -> float:
    """Share of the compensation granted at these speeds, 1 to 0."""
    near = tool_speed / limits.tool_speed
    for j in range(qd.shape[0]):
        near = max(near, abs(qd[j]) / limits.joint_speed)
    return min(max((1.0 - near) / (1.0 - FADE_FROM), 0.0), 1.0)


@kernel
def watch_guiding(
    limits: GuidingLimits,
    belief: Belief,
    gains: GuidingGains,
    memory: GuidingMemory,
    tool_speed: float,
    dt: float,
) -> int:
    """Add the energy lent in a step to ``limits.lent``; returns the code of the guard that stops the arm, or
    0.

    ``memory``: after the law's step; ``tool_speed``: of the tool point [m/s].
    """
    power = 0.0
    code = 0
    for j in range(memory.qd.shape[0]):
        qd = memory.qd[j]
        lost = dry_friction(belief, memory, j, qd) * math.tanh(qd / gains.sign_speed) + belief.viscous[j] * qd
        carried = gains.gravity * (memory.weight[j] + gains.tare * memory.tare[j])
        power += qd * (memory.torque[j] - carried - lost)
        if abs(qd) > limits.joint_speed:
            code = JOINT_SPEED
    limits.lent.now = max(limits.lent.now + dt * power, 0.0)
    limits.lent.most = max(limits.lent.most, limits.lent.now)
    if tool_speed > limits.tool_speed:
        code = TOOL_SPEED
    if limits.lent.now > limits.energy:
        code = ENERGY
    return code
