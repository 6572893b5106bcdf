"""Bodies: identified parameters that can exist, and payloads."""

import mujoco
import numpy as np
import pytest

from polish_sim.errors import IdentificationError
from polish_sim.identification import payload
from polish_sim.identification.estimate import INTERVAL_95, estimate, sum_samples, torque_error
from polish_sim.identification.model_file import IdentifiedJoints, identified_xml
from polish_sim.identification.physical import Drawing, fit_consistent, is_consistent, pseudo_inertia
from polish_sim.identification.regressor import States
from polish_sim.identification.robot_model import ARM_JOINTS, CarriedLoad, own_parameters
from polish_sim.motion.serial_chain import inertia_at_origin, link_parameters
from tests.identification.known import arm_chain, arm_model, known_robot, noisy

KNOWN = known_robot(samples=500)


def test_every_fit_is_consistent_and_predicts_as_well_as_its_base_parameters():
    other = known_robot(seed=7)
    ratios = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        factor = np.exp(0.15 * rng.normal(size=(6, 1)))
        believed = KNOWN.model.truth()
        believed[:60] = (arm_chain().parameters * factor).ravel()
        sums = sum_samples(KNOWN.model, KNOWN.base, KNOWN.states, noisy(KNOWN.torque, rng))
        found = estimate(sums)
        full = fit_consistent(KNOWN.model, KNOWN.base, found, Drawing(believed, np.zeros((6, 10))))
        assert is_consistent(full[:60].reshape(6, 10))
        assert full[60:78].min() >= 0.0
        consistent, free = (
            KNOWN.model.torque_of_base(other.states, KNOWN.base.columns, theta)
            for theta in (KNOWN.base.combination @ full, found.theta)
        )
        errors = [np.linalg.norm(torque_error(each, other.torque)) for each in (consistent, free)]
        ratios.append(errors[0] / errors[1])
    assert float(np.mean(ratios)) <= 1.02


def test_links_of_the_model_are_consistent_and_the_written_model_is_the_identified_one():
    parameters = arm_chain().parameters.copy()
    J = pseudo_inertia(parameters[2])
    assert [J[3, 3], *J[3, :3]] == [*parameters[2, :4]]
    inertia = np.trace(J[:3, :3]) * np.eye(3) - J[:3, :3]
    np.testing.assert_allclose(inertia, inertia_at_origin(parameters[2]), atol=1e-14)
    assert is_consistent(parameters)
    parameters[1, 0] = -1.0
    assert not is_consistent(parameters)
    own, damping = own_parameters(arm_model(), ARM_JOINTS), 0.5 * np.arange(6.0)
    model = mujoco.MjModel.from_xml_string(identified_xml(ARM_JOINTS, IdentifiedJoints(1.1 * own, damping)))
    np.testing.assert_allclose(own_parameters(model, ARM_JOINTS), 1.1 * own, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(model.dof_damping.reshape(model.nv, -1)[:6, 0], damping)


ORIGIN = KNOWN.model.chain.origins[-1]
LOAD = CarriedLoad(1.5, np.array([0.02, -0.01, 0.08]), np.diag([0.002, 0.003, 0.004]))
PLANTED = link_parameters(LOAD.mass, LOAD.center - ORIGIN, LOAD.inertia)
TORQUE = KNOWN.torque + KNOWN.model.regressor(KNOWN.states)[:, :, 50:60] @ PLANTED


def _found(rng: np.random.Generator) -> payload.FoundPayload:
    empty = sum_samples(KNOWN.model, KNOWN.base, KNOWN.states, noisy(KNOWN.torque, rng))
    return payload.fit_link_payload(KNOWN.model, KNOWN.base, empty, KNOWN.states, noisy(TORQUE, rng))


def on_known_arm(torque: np.ndarray, states: States = KNOWN.states) -> payload.FoundPayload:
    return payload.fit_payload_on_known_arm(KNOWN.model, KNOWN.base, KNOWN.truth, states, torque)


def test_intervals_of_mass_centre_and_inertia_hold_the_truth_in_95_of_100_draws():
    rng, truth = np.random.default_rng(0), payload.body_of(PLANTED, ORIGIN)
    covered, off = [], []
    for _draw in range(60):
        values, std = _found(rng).body()
        covered.append(np.abs(values - truth) <= INTERVAL_95 * std)
        off.append((values - truth) / std)
    # Six hundred correlated intervals.
    assert 0.91 < float(np.mean(covered)) < 0.985
    assert 0.9 < float(np.sqrt(np.mean(np.square(off)))) < 1.1


def test_a_known_arm_tells_its_payload_surely_a_small_one_as_the_nearest_body_and_on_a_still_wrist_none():
    rng = np.random.default_rng(1)
    alone = on_known_arm(noisy(TORQUE, rng))
    assert np.abs((alone.parameters - PLANTED) / alone.std).max() < 4.0
    assert np.all(alone.std < _found(rng).std)
    rng = np.random.default_rng(2)
    impossible = 0
    for _draw in range(5):
        found = on_known_arm(noisy(KNOWN.torque, rng))
        impossible += not is_consistent(found.parameters[None])
        nearest = found.nearest_body()
        assert is_consistent(nearest[None])
        # No body at all is nearer to what was found than twice the noise; the nearest body is nearer still.
        weight = np.linalg.inv(found.covariance)
        off, none = nearest - found.parameters, found.parameters
        assert off @ weight @ off <= none @ weight @ none + 1e-3
    assert impossible > 0
    states = KNOWN.with_still(slice(1, 6))(np.arange(1000) / 100.0)
    with pytest.raises(IdentificationError, match=r"payload mcz"):
        on_known_arm(KNOWN.model.torque(states, KNOWN.model.truth()), states)
