"""Regressor, base parameters, payloads: the papers' counts, the Cramér-Rao bound, intervals that hold."""

import mujoco
import numpy as np
import pytest
from scipy.signal import lfilter

from polish_sim.errors import IdentificationError, InputError
from polish_sim.identification import estimate, payload, regressor
from polish_sim.identification.estimate import base_names, base_of, base_of_rows, identifiable
from polish_sim.identification.model_file import identified_xml
from polish_sim.identification.physical import Drawing, fit_consistent, is_consistent, pseudo_inertia
from polish_sim.identification.robot_model import ARM_JOINTS, CarriedLoad, own_parameters, read_chain
from polish_sim.motion.serial_chain import inertia_at_origin, link_parameters
from tests.identification import known
from tests.identification.known import SIGMA, arm_chain, arm_model, covers, known_robot, noisy

LINK = '<geom size="0.1"/>'
HINGE = f'<body name="x"><joint name="a"/>{LINK}</body>'
PAIR = f'<worldbody><body><joint name="a"/>{LINK}<body><joint name="b"/>{LINK}</body></body></worldbody>'
RING = '<equality><connect name="ring" body1="x" anchor="0 0 1"/></equality>'
BELT = '<tendon><fixed name="belt"><joint joint="a" coef="1"/><joint joint="b" coef="-1"/></fixed></tendon>'
RNG = np.random.default_rng
KNOWN, LONG = known_robot(), known_robot(4000)
SPARSE = known_robot(samples=500)
ORIGIN = SPARSE.model.chain.origins[-1]
LOAD = CarriedLoad(1.5, np.array([0.02, -0.01, 0.08]), np.diag([0.002, 0.003, 0.004]))
ON_FLANGE = link_parameters(LOAD.mass, LOAD.center - ORIGIN, LOAD.inertia)
TORQUE = SPARSE.torque + SPARSE.model.regressor(SPARSE.states)[:, :, 50:60] @ ON_FLANGE


@pytest.mark.parametrize(("engine", "joints"), [(arm_model(), ARM_JOINTS), (known.odd_model(), None)])
def test_torques_are_the_engines_also_of_slides_tilted_axes_and_two_joints_on_a_body(engine, joints):
    terms = ("viscous", "armature")
    model = regressor.TorqueModel(read_chain(engine, joints), terms)
    states = regressor.random_states(model.joints, 200, np.random.default_rng(0))
    torque = model.torque(states, model.truth())
    assert np.abs(torque - known.inverse_dynamics(engine, *states)).max() <= 1e-10
    assert np.abs(torque).max() > 50.0


def test_derivatives_are_the_slopes_of_central_differences():
    geometry, step = arm_chain().geometry, 1e-6
    states = regressor.random_states(6, 4, np.random.default_rng(3))
    slopes = regressor.regressor_derivatives(geometry, *states)
    flat = np.concatenate(states, axis=1)
    for column in range(18):
        ends = []
        for sign in (1.0, -1.0):
            moved = flat.copy()
            moved[:, column] += sign * step
            ends.append(regressor.rigid_regressor(geometry, moved[:, :6], moved[:, 6:12], moved[:, 12:]))
        np.testing.assert_allclose(slopes[:, column], (ends[0] - ends[1]) / (2.0 * step), atol=1e-6)


@pytest.mark.parametrize(
    ("xml", "said"),
    [
        (f'<worldbody><body><joint name="p" type="ball"/>{LINK}</body></worldbody>', "'p' is a ball joint"),
        (f'<worldbody>{HINGE}<body><joint name="b"/>{LINK}</body></worldbody>', "branches at joint 'b'"),
        (f"<worldbody><body>{LINK}</body></worldbody>", "no joint"),
        (f"<worldbody>{HINGE}</worldbody>{RING}", r"ring.*closed loop"),
        (PAIR + BELT, r"tendon \(belt\) ties joint 'a'"),
    ],
)
def test_what_is_no_serial_chain_is_refused_by_name(xml, said):
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    with pytest.raises(InputError, match=said):
        read_chain(model)
    with pytest.raises(InputError, match="elbow_joint"):  # the known ones
        read_chain(arm_model(), (*ARM_JOINTS, "knee"))


@pytest.mark.parametrize(
    ("terms", "papers"),
    [((), 36), (("viscous", "coulomb", "armature"), 52), (("viscous", "coulomb", "armature", "offset"), 58)],
)
def test_the_rank_is_the_papers(terms, papers):
    assert base_of(regressor.TorqueModel(arm_chain(), terms)).rank == papers


def rank(rows):
    """Number of base parameters of regressor rows (m, joints, columns)."""
    return base_of_rows(rows.reshape(-1, rows.shape[2])).rank


def test_poses_at_rest_tell_ten_numbers_and_what_base_parameters_leave_out_moves_nothing():
    q, rigid = regressor.random_states(6, 100, RNG(1)).q, regressor.TorqueModel(arm_chain(), ())
    assert rank(rigid.regressor(regressor.States(q, 0.0 * q, 0.0 * q))) == 10
    states = regressor.random_states(6, 200, RNG(2))
    for part in states[1:]:
        part[:, 3:] = 0.0
    states.q[:, 3:] = (0.3, -1.1, 0.7)
    assert rank(rigid.regressor(states)[:, :3]) == 15
    model = regressor.TorqueModel(arm_chain())
    base, states = base_of(model), regressor.random_states(6, 50, RNG(4))
    torque = model.regressor(states)[:, :, base.columns] @ (base.combination @ model.truth())
    np.testing.assert_allclose(torque, model.torque(states, model.truth()), atol=1e-9)
    hidden = base.null_space() @ RNG(6).normal(size=model.columns - base.rank)
    assert np.abs(model.torque(states, hidden)).max() < 1e-8
    model = regressor.TorqueModel(arm_chain(), ("viscous", "coulomb", "armature"))
    said = dict(zip(model.names, identifiable(base_of(model)), strict=True))
    assert (said["m1"], said["fc4"], said["Izz2"]) == ("no", "alone", "combined")
    assert any(name.startswith("Izz2 + ") for name in base_names(base_of(model), model.names))


def sums_of(torque):
    return estimate.sum_samples(KNOWN.model, KNOWN.base, KNOWN.states, torque)


def test_errors_are_at_the_cramer_rao_bound_in_their_intervals_and_each_joints_noise_is_found():
    rng = np.random.default_rng(0)
    squares, covered = [], []
    for _draw in range(50):
        sums = sums_of(noisy(KNOWN.torque, rng))
        found = estimate.estimate(sums)
        squares.append((found.theta - KNOWN.truth) ** 2)
        covered.append(covers(found, KNOWN.truth))
    bound = np.diag(estimate.inverse_of(estimate.information(sums, SIGMA)))
    ratio = float(np.sqrt(np.mean(np.mean(squares, axis=0) / bound)))
    # Fifty draws of fifty-eight correlated numbers determine this ratio to some 2%.
    assert 0.95 < ratio < 1.05
    assert 0.93 <= float(np.mean(covered)) <= 0.97
    other = known_robot(seed=5)
    found = estimate.estimate(sums_of(noisy(KNOWN.torque, np.random.default_rng(1))))
    np.testing.assert_allclose(found.sigma, SIGMA, rtol=0.05)
    predicted = KNOWN.model.torque(other.states, found.theta, KNOWN.base.columns)
    assert estimate.torque_error(predicted, other.torque).max() < 0.01


@pytest.mark.parametrize(
    ("still", "said"), [(slice(3, 4), "wrist_1_joint .*fc4.*fv4"), (slice(1, 6), r"of 58 base parameters")]
)
def test_a_joint_that_stands_still_is_named_with_what_stays_unknown(still, said):
    states = KNOWN.with_still(still)(np.arange(1000) / 100.0)
    torque = KNOWN.model.torque(states, KNOWN.model.truth())
    sums = estimate.sum_samples(KNOWN.model, KNOWN.base, states, torque)
    with pytest.raises(IdentificationError, match=said):
        estimate.require_excited(sums, KNOWN.base, KNOWN.model)


def _noise(keep, rng, samples=4000):
    """Noise of unit variance of which each sample keeps a share of the one before."""
    white = rng.normal(size=(samples, 6))
    return np.asarray(lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white, axis=0))


@pytest.mark.parametrize("keep", [0.0, 0.9])
def test_the_inefficiency_is_that_of_the_noise(keep):
    rng = np.random.default_rng(0)
    told = rng.random((100_000, 6)) > 0.1
    found = estimate.inefficiency(_noise(keep, rng, 100_000) * [1.0, 2.0, 3.0, 1.0, 1.0, 1.0], told)
    np.testing.assert_allclose(found, (1.0 + keep) / (1.0 - keep), rtol=0.15)


@pytest.mark.parametrize(("keep", "white_covers"), [(0.0, 0.93), (0.9, 0.0)])
def test_intervals_hold_the_truth_whatever_the_noises_colour(keep, white_covers):
    rng = np.random.default_rng(1)
    white, widened = [], []
    for _draw in range(20):
        torque = LONG.torque + _noise(keep, rng) * SIGMA
        sums = estimate.sum_samples(LONG.model, LONG.base, LONG.states, torque)
        white.append(covers(estimate.estimate(sums), LONG.truth))
        found = estimate.estimate_widened(LONG.model, LONG.base, sums, LONG.states, torque)
        widened.append(covers(found, LONG.truth))
        np.testing.assert_allclose(found.sigma, SIGMA, rtol=0.25)
    assert 0.90 < float(np.mean(widened)) < 0.99
    assert white_covers <= float(np.mean(white)) < max(2.0 * white_covers, 0.6)


def test_every_fit_is_consistent_and_predicts_as_well_as_its_base_parameters():
    other = known_robot(seed=7)
    ratios = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        factor = np.exp(0.15 * rng.normal(size=(6, 1)))
        believed = SPARSE.model.truth()
        believed[:60] = (arm_chain().parameters * factor).ravel()
        sums = estimate.sum_samples(SPARSE.model, SPARSE.base, SPARSE.states, noisy(SPARSE.torque, rng))
        found = estimate.estimate(sums)
        full = fit_consistent(SPARSE.model, SPARSE.base, found, Drawing(believed, np.zeros((6, 10))))
        assert is_consistent(full[:60].reshape(6, 10))
        assert full[60:78].min() >= 0.0
        thetas = SPARSE.base.combination @ full, found.theta
        torques = (SPARSE.model.torque(other.states, theta, SPARSE.base.columns) for theta in thetas)
        errors = [np.linalg.norm(estimate.torque_error(each, other.torque)) for each in torques]
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
    model = mujoco.MjModel.from_xml_string(identified_xml(ARM_JOINTS, 1.1 * own, {"viscous": damping}))
    np.testing.assert_allclose(own_parameters(model, ARM_JOINTS), 1.1 * own, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(model.dof_damping.reshape(model.nv, -1)[:6, 0], damping)


def _payload(rng, torque=TORQUE, states=SPARSE.states):
    empty = estimate.sum_samples(SPARSE.model, SPARSE.base, SPARSE.states, noisy(SPARSE.torque, rng))
    return payload.fit_link_payload(SPARSE.model, SPARSE.base, empty, states, noisy(torque, rng))


def test_intervals_of_mass_centre_and_inertia_hold_the_truth_in_95_of_100_draws():
    rng, truth = np.random.default_rng(0), payload.body_of(ON_FLANGE, ORIGIN)
    covered, off = [], []
    for _draw in range(60):
        values, std = _payload(rng).body()
        covered.append(np.abs(values - truth) <= estimate.INTERVAL_95 * std)
        off.append((values - truth) / std)
    # Six hundred correlated intervals.
    assert 0.91 < float(np.mean(covered)) < 0.985
    assert 0.9 < float(np.sqrt(np.mean(np.square(off)))) < 1.1


def test_no_payload_is_the_nearest_body_and_on_a_still_wrist_there_is_none():
    rng = np.random.default_rng(2)
    impossible = 0
    for _draw in range(5):
        found = _payload(rng, SPARSE.torque)
        impossible += not is_consistent(found.parameters[None])
        nearest = found.nearest_body()
        assert is_consistent(nearest[None])
        # No body at all is nearer to what was found than twice the noise; the nearest body is nearer still.
        weight = np.linalg.inv(found.covariance)
        off, none = nearest - found.parameters, found.parameters
        assert off @ weight @ off <= none @ weight @ none + 1e-3
    assert impossible > 0
    states = SPARSE.with_still(slice(1, 6))(np.arange(1000) / 100.0)
    with pytest.raises(IdentificationError, match=r"payload mcz"):
        _payload(rng, SPARSE.model.torque(states, SPARSE.model.truth()), states)
