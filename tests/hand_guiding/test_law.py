"""Laws of hand guiding on plain arrays: one joint with known inertia, weight and friction."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from polish_sim.config import GuideConfig
from polish_sim.hand_guiding.law import (
    ENERGY,
    JOINT_SPEED,
    TOOL_SPEED,
    Belief,
    GuidingGains,
    GuidingLimits,
    GuidingMemory,
    Lent,
    build_memory,
    fade_out,
    gains_of,
    guide_by_hand,
    read_encoders,
    watch_guiding,
)
from polish_sim.motion.serial_chain import HINGE, ChainGeometry, SerialChain, chain_model, link_parameters

DT = 0.001
MASS, ARM, ROTOR = 3.0, 0.4, 1.0
INERTIA = MASS * ARM**2 + ROTOR
COULOMB, VISCOUS, CREEP = 5.0, 8.0, 0.003
Pushed = tuple[GuidingMemory, list[float]]


@pytest.fixture
def belief() -> Belief:
    """A point mass on a rod that turns about a level axis, level at zero."""
    geometry = ChainGeometry(
        np.array([HINGE]),
        np.zeros((1, 3)),
        np.eye(3)[None],
        np.array([[0.0, -1.0, 0.0]]),
        np.array([0.0, 0.0, -9.81]),
    )
    links = link_parameters(MASS, np.array([ARM, 0.0, 0.0]), np.zeros((3, 3)))[None]
    friction = np.array([VISCOUS]), np.array([COULOMB])
    chain = SerialChain(
        geometry, links, np.array([ROTOR]), *friction, ("shoulder",), ("rod",), np.zeros((1, 3))
    )
    return Belief(
        chain_model(chain),
        np.array([COULOMB]),
        np.array([VISCOUS]),
        np.array([CREEP]),
        np.array([150.0]),
        np.zeros(1),
        np.zeros(1),
    )


def gains(mode: str, **changed: float) -> GuidingGains:
    return gains_of(mode, GuideConfig(encoder_rad=0.0, **changed), DT)


def torque_at(belief: Belief, mode: str, q: float, qd: float, qdd: float = 0.0) -> float:
    memory = build_memory(1)
    memory.q[0], memory.qd[0], memory.qdd[0] = q, qd, qdd
    guide_by_hand(belief, gains(mode), memory, 1.0, DT)
    return float(memory.torque[0])


def limits(**changed: float) -> GuidingLimits:
    usual = {"joint_speed": 3.0, "tool_speed": 1.5, "energy": 40.0} | changed
    return GuidingLimits(**usual, lent=Lent())


@pytest.mark.parametrize("q", [0.0, 0.7, -1.2])
def test_gravity_is_carried_and_nothing_else(belief: Belief, q: float) -> None:
    assert torque_at(belief, "gravity", q, 1.0, 5.0) == pytest.approx(
        MASS * 9.81 * ARM * math.cos(q), abs=1e-12
    )
    assert torque_at(belief, "none", q, 1.0, 5.0) == 0.0


def test_the_classical_law_gives_back_its_share_of_friction(belief: Belief) -> None:
    eased = torque_at(belief, "classical", 0.3, 1.0, 5.0) - torque_at(belief, "gravity", 0.3, 1.0)
    assert eased == pytest.approx(0.95 * (COULOMB + VISCOUS * 1.0), rel=1e-12)
    assert torque_at(belief, "classical", 0.3, 0.0) == torque_at(belief, "gravity", 0.3, 0.0)


def test_the_improved_law_takes_alpha_of_the_inertia(belief: Belief) -> None:
    eased = torque_at(belief, "inertia", 0.3, 1.0, 5.0) - torque_at(belief, "classical", 0.3, 1.0)
    assert eased == pytest.approx(0.8 * INERTIA * 5.0, rel=1e-12)


def test_motors_are_never_asked_for_more_than_they_have(belief: Belief) -> None:
    assert torque_at(belief, "inertia", 0.0, 1.0, 1e4) == 150.0


def pushed(
    belief: Belief, law: GuidingGains, hand: float, steps: int, rubbing: Callable[[float], float]
) -> Pushed:
    """A joint under the law and a hand's constant torque [N m], with friction by its speed."""
    memory, q, qd, reached = build_memory(1), 0.0, 0.0, []
    for step in range(steps):
        read_encoders(law, memory, np.array([q]), DT, step == 0)
        guide_by_hand(belief, law, memory, 1.0, DT)
        weight = MASS * 9.81 * ARM * math.cos(q)
        qd += DT * (memory.torque[0] + hand - weight - rubbing(qd)) / INERTIA
        q += DT * qd
        reached.append(qd)
    return memory, reached


@pytest.mark.parametrize("over", [0.0, 0.2])
def test_a_held_share_of_inertia_is_what_the_hand_feels_less(belief: Belief, over: float) -> None:
    """A hand's constant torque speeds the joint up as if it had (1 - alpha (1 + over)) of its inertia, and
    stably."""
    law = gains("inertia", inertia_share=0.8 * (1.0 + over))
    _, reached = pushed(
        belief, law, 0.5, 1500, lambda qd: (COULOMB * math.tanh(qd / law.sign_speed) + VISCOUS * qd) * 0.95
    )
    felt = 0.5 * 500 * DT / (reached[1499] - reached[999])
    assert felt == pytest.approx((1.0 - 0.8 * (1.0 + over)) * INERTIA, rel=0.05)


def test_the_observer_finds_the_torque_of_the_hand(belief: Belief) -> None:
    law = gains("assist", hand_felt=0.0)
    memory, _ = pushed(
        belief, law, 2.0, 400, lambda qd: COULOMB * min(max(qd / CREEP, -1.0), 1.0) + VISCOUS * qd
    )
    assert memory.external[0] == pytest.approx(2.0, rel=0.05)


def test_without_a_hand_friction_is_left_to_the_joint(belief: Belief) -> None:
    memory, law = build_memory(1), gains("assist")
    memory.q[0], memory.qd[0], memory.grip[0] = 0.3, 1.0, 1.0
    memory.impulse[0] = INERTIA * 1.0
    # The torque that keeps 1 rad/s without the hand: what the observer expects.
    for _ in range(300):
        memory.torque[0] = MASS * 9.81 * ARM * math.cos(0.3) + COULOMB + VISCOUS
        guide_by_hand(belief, law, memory, 1.0, DT)
    assert memory.grip[0] == 0.0
    assert memory.torque[0] == pytest.approx(MASS * 9.81 * ARM * math.cos(0.3))


def test_an_elastic_joint_is_helped_the_way_it_was_moved_last(belief: Belief) -> None:
    """Also while it stands."""
    memory, law = build_memory(1), gains("assist", hand_felt=0.0)._replace(start=1e-5)
    for speed, way in ((0.02, 1.0), (0.0, 1.0), (-0.02, -1.0)):
        memory.qd[0] = speed
        guide_by_hand(belief, law, memory, 1.0, DT)
        eased = memory.torque[0] - memory.weight[0]
        assert eased == pytest.approx(0.95 * (COULOMB * way + VISCOUS * speed), abs=1e-9)


def test_encoders_read_in_steps() -> None:
    memory, law = build_memory(1), gains("inertia")._replace(encoder=1e-3)
    read_encoders(law, memory, np.array([0.0104]), DT, True)
    assert (memory.q[0], memory.qd[0]) == (pytest.approx(0.010), 0.0)
    read_encoders(law, memory, np.array([0.0106]), DT, False)
    assert memory.qd[0] == pytest.approx(1.0)


def lend(belief: Belief, law: GuidingGains, seconds: float) -> tuple[GuidingMemory, GuidingLimits, int]:
    """Watch a joint that keeps on moving at 1 rad/s."""
    memory, watched, code = build_memory(1), limits(), 0
    memory.qd[0] = 1.0
    for _ in range(round(seconds / DT)):
        guide_by_hand(belief, law, memory, 1.0, DT)
        code = code or watch_guiding(watched, belief, law, memory, 0.4, DT)
    return memory, watched, code


def test_compensating_less_than_friction_takes_lends_nothing(belief: Belief) -> None:
    _, watched, code = lend(belief, gains("classical"), 10.0)
    assert (watched.lent.most, code) == (0.0, 0)


def test_compensating_more_than_friction_takes_is_counted_and_stopped(belief: Belief) -> None:
    law = gains("classical", coulomb_share=1.5, viscous_share=1.5)
    _, watched, code = lend(belief, law, 1.0)
    assert code == 0
    assert watched.lent.most == pytest.approx(0.5 * (COULOMB + VISCOUS), rel=1e-9)
    assert lend(belief, law, 10.0)[2] == ENERGY


@pytest.mark.parametrize(
    ("qd", "tool", "code"), [(3.1, 0.1, JOINT_SPEED), (1.0, 1.6, TOOL_SPEED), (1.0, 0.1, 0)]
)
def test_speeds_beyond_their_limits_stop(belief: Belief, qd: float, tool: float, code: int) -> None:
    memory = build_memory(1)
    memory.qd[0] = qd
    assert watch_guiding(limits(), belief, gains("gravity"), memory, tool, DT) == code


def test_compensation_fades_towards_a_speed_limit() -> None:
    assert fade_out(limits(), np.array([1.0]), 0.5) == 1.0
    assert fade_out(limits(), np.array([2.85]), 0.5) == pytest.approx(0.5)
    assert fade_out(limits(), np.array([1.0]), 1.5) == 0.0
