"""Full parameters a body can have: always consistent, and as good as the estimate they come from."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.identification.estimate import estimate, held_out_error, sum_samples
from polish_sim.identification.model_file import IdentifiedJoints, identified_xml
from polish_sim.identification.physical import Drawing, fit_consistent, is_consistent, parameters_of, pseudo_inertia
from tests.identification.chains import ARM, arm_chain
from tests.identification.motions import known_robot, noisy

KNOWN = known_robot()


def test_pseudo_inertia_and_parameters_are_each_others_inverse() -> None:
    link = arm_chain().parameters[2]
    np.testing.assert_allclose(parameters_of(pseudo_inertia(link)), link, atol=1e-14)


def test_every_link_of_the_model_is_consistent_and_one_of_negative_mass_is_not() -> None:
    parameters = arm_chain().parameters.copy()
    assert is_consistent(parameters)
    parameters[1, 0] = -1.0
    assert not is_consistent(parameters)


def test_every_fit_is_consistent_and_predicts_as_well_as_its_base_parameters() -> None:
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
        errors = [
            np.linalg.norm(held_out_error(KNOWN.model, KNOWN.base, theta, other.states, other.torque))
            for theta in (KNOWN.base.combination @ full, found.theta)
        ]
        ratios.append(errors[0] / errors[1])
    assert float(np.mean(ratios)) <= 1.02


def test_the_written_model_is_the_identified_one() -> None:
    mujoco = pytest.importorskip("mujoco")
    from polish_sim.identification.robot_model import own_parameters

    model = mujoco.MjModel.from_xml_string(identified_xml(ARM, IdentifiedJoints(1.1 * _own(), 0.5 * np.arange(6.0))))
    np.testing.assert_allclose(own_parameters(model, ARM), 1.1 * _own(), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(model.dof_damping.reshape(model.nv, -1)[:6, 0], 0.5 * np.arange(6.0))


def _own() -> np.ndarray:
    from polish_sim.identification.robot_model import own_parameters
    from tests.identification.chains import arm_model

    return own_parameters(arm_model(), ARM)
