"""Laws of hand guiding on plain arrays: one joint with known inertia, weight and friction."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from polish_sim.config import GuideConfig
from polish_sim.hand_guiding import law as laws
from polish_sim.motion.serial_chain import HINGE, ChainGeometry, SerialChain, chain_model, link_parameters

DT = 0.001
MASS, ARM, ROTOR = 3.0, 0.4, 1.0
INERTIA = MASS * ARM**2 + ROTOR
COULOMB, VISCOUS, CREEP = 5.0, 8.0, 0.003
Pushed = tuple[laws.GuidingMemory, list[float]]


@pytest.fixture
def belief() -> laws.Belief:
    """A point mass on a rod that turns about a level axis, level at zero."""
    axis, gravity = np.array([[0.0, -1.0, 0.0]]), np.array([0.0, 0.0, -9.81])
    geometry = ChainGeometry(np.array([HINGE]), np.zeros((1, 3)), np.eye(3)[None], axis, gravity)
    links = link_parameters(MASS, np.array([ARM, 0.0, 0.0]), np.zeros((3, 3)))[None]
    friction = np.array([VISCOUS]), np.array([COULOMB])
    names = ("shoulder",), ("rod",)
    chain = SerialChain(geometry, links, np.array([ROTOR]), *friction, *names, np.zeros((1, 3)))
    own = (np.array([value]) for value in (COULOMB, VISCOUS, CREEP, 150.0, 0.0, 0.0))
    return laws.Belief(chain_model(chain), *own)


def gains(mode: str, **changed: float) -> laws.GuidingGains:
    return laws.gains_of(mode, GuideConfig(encoder_rad=0.0, **changed), DT)


def torque_at(belief: laws.Belief, mode: str, q: float, qd: float, qdd: float = 0.0) -> float:
    memory = laws.build_memory(1)
    memory.q[0], memory.qd[0], memory.qdd[0] = q, qd, qdd
    laws.guide_by_hand(belief, gains(mode), memory, 1.0, DT)
    return float(memory.torque[0])


def limits() -> laws.GuidingLimits:
    return laws.GuidingLimits(joint_speed=3.0, tool_speed=1.5, energy=40.0, lent=laws.Lent())


def test_each_mode_gives_back_its_share_of_weight_friction_and_inertia(belief):
    weight = MASS * 9.81 * ARM * math.cos(0.3)
    friction = 0.95 * (COULOMB + VISCOUS * 1.0)
    moving = [torque_at(belief, mode, 0.3, 1.0, 5.0) for mode in ("none", "gravity", "classical", "inertia")]
    expected = [0.0, weight, weight + friction, weight + friction + 0.8 * INERTIA * 5.0]
    np.testing.assert_allclose(moving, expected, rtol=1e-12)
    assert torque_at(belief, "classical", 0.3, 0.0) == pytest.approx(weight)
    assert torque_at(belief, "inertia", 0.0, 1.0, 1e4) == 150.0  # all that the motor has


def pushed(
    belief: laws.Belief, law: laws.GuidingGains, hand: float, steps: int, rubbing: Callable[[float], float]
) -> Pushed:
    """A joint under the law and a hand's constant torque [N m], with friction by its speed."""
    memory, q, qd, reached = laws.build_memory(1), 0.0, 0.0, []
    for step in range(steps):
        laws.quantize_encoders(law, memory, np.array([q]), DT, step == 0)
        laws.guide_by_hand(belief, law, memory, 1.0, DT)
        weight = MASS * 9.81 * ARM * math.cos(q)
        qd += DT * (memory.torque[0] + hand - weight - rubbing(qd)) / INERTIA
        q += DT * qd
        reached.append(qd)
    return memory, reached


def test_a_held_share_of_inertia_is_what_the_hand_feels_less(belief):
    """Also where the inertia is taken for a fifth more than it is."""

    def rubbing(qd: float) -> float:
        return 0.95 * (COULOMB * math.tanh(qd / gains("inertia").sign_speed) + VISCOUS * qd)

    for share in (0.8, 0.96):
        _, reached = pushed(belief, gains("inertia", inertia_share=share), 0.5, 1500, rubbing)
        felt = 0.5 * 500 * DT / (reached[1499] - reached[999])
        assert felt == pytest.approx((1.0 - share) * INERTIA, rel=0.05)


def test_the_observer_finds_the_torque_of_the_hand_and_without_one_friction_is_left_to_the_joint(belief):
    def rubbing(qd: float) -> float:
        return COULOMB * min(max(qd / CREEP, -1.0), 1.0) + VISCOUS * qd

    memory, _ = pushed(belief, gains("assist", hand_felt=0.0), 2.0, 400, rubbing)
    assert memory.external[0] == pytest.approx(2.0, rel=0.05)
    memory, law = laws.build_memory(1), gains("assist")
    memory.q[0], memory.qd[0], memory.grip[0] = 0.3, 1.0, 1.0
    memory.impulse[0] = INERTIA * 1.0
    # The torque that keeps 1 rad/s without the hand: what the observer expects.
    for _ in range(300):
        memory.torque[0] = MASS * 9.81 * ARM * math.cos(0.3) + COULOMB + VISCOUS
        laws.guide_by_hand(belief, law, memory, 1.0, DT)
    assert memory.grip[0] == 0.0
    assert memory.torque[0] == pytest.approx(MASS * 9.81 * ARM * math.cos(0.3))


def test_an_elastic_joint_is_helped_the_way_it_was_moved_last(belief):
    """Also while it stands."""
    memory, law = laws.build_memory(1), gains("assist", hand_felt=0.0)._replace(start=1e-5)
    for speed, way in ((0.02, 1.0), (0.0, 1.0), (-0.02, -1.0)):
        memory.qd[0] = speed
        laws.guide_by_hand(belief, law, memory, 1.0, DT)
        eased = memory.torque[0] - memory.weight[0]
        assert eased == pytest.approx(0.95 * (COULOMB * way + VISCOUS * speed), abs=1e-9)


def lend(
    belief: laws.Belief, law: laws.GuidingGains, seconds: float
) -> tuple[laws.GuidingMemory, laws.GuidingLimits, int]:
    """Watch a joint that keeps on moving at 1 rad/s."""
    memory, watched, code = laws.build_memory(1), limits(), 0
    memory.qd[0] = 1.0
    for _ in range(round(seconds / DT)):
        laws.guide_by_hand(belief, law, memory, 1.0, DT)
        code = code or laws.watch_guiding(watched, belief, law, memory, 0.4, DT)
    return watched, code


def test_compensation_fades_towards_speed_limits_and_one_that_lends_too_much_energy_is_stopped(belief):
    memory = laws.build_memory(1)
    for memory.qd[0], tool, share, code in (
        (1.0, 0.5, 1.0, 0),
        (2.85, 0.5, 0.5, 0),
        (1.0, 1.6, 0.0, laws.TOOL_SPEED),
        (3.1, 0.1, 0.0, laws.JOINT_SPEED),
    ):
        assert laws.watch_guiding(limits(), belief, gains("gravity"), memory, tool, DT) == code
        assert laws.fade_out(limits(), memory.qd, tool) == pytest.approx(share)
    # Compensating more than friction takes is counted.
    law = gains("classical", coulomb_share=1.5, viscous_share=1.5)
    watched, code = lend(belief, law, 1.0)
    assert code == 0
    assert watched.lent.most == pytest.approx(0.5 * (COULOMB + VISCOUS), rel=1e-9)
    assert lend(belief, law, 10.0)[1] == laws.ENERGY
    watched, code = lend(belief, gains("classical"), 10.0)
    assert (watched.lent.most, code) == (0.0, 0)
