"""How many numbers torques tell: the ranks of a floor-mounted six-axis arm are known."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.identification.estimate import base_names, base_of, base_of_rows, identifiable
from polish_sim.identification.regressor import States, TorqueModel, random_states
from tests.identification.chains import arm_chain

RNG = np.random.default_rng


@pytest.mark.parametrize(
    ("terms", "rank"),
    [
        ((), 36),
        (("viscous", "coulomb"), 48),
        (("viscous", "coulomb", "offset"), 54),
        (("viscous", "coulomb", "armature"), 52),
        (("viscous", "coulomb", "armature", "offset"), 58),
    ],
)
def test_the_rank_is_the_papers(terms: tuple[str, ...], rank: int) -> None:
    assert base_of(TorqueModel(arm_chain(), terms)).rank == rank


def test_poses_at_rest_tell_ten_numbers() -> None:
    model = TorqueModel(arm_chain(), ())
    q = random_states(6, 100, RNG(0)).q
    rows = model.regressor(States(q, 0.0 * q, 0.0 * q)).reshape(-1, model.columns)
    assert base_of_rows(rows).rank == 10


def test_poses_approached_slowly_from_both_sides_tell_sixteen() -> None:
    model = TorqueModel(arm_chain(), ("coulomb",))
    q = np.repeat(random_states(6, 100, RNG(1)).q, 2, axis=0)
    side = np.where(np.arange(200) % 2, 1.0, -1.0)[:, None] * np.ones(6)
    rows = model.regressor(States(q, side, 0.0 * q))
    # Slow: friction has its sign, inertia shows nothing.
    rows[:, :, :60] = model.regressor(States(q, 0.0 * q, 0.0 * q))[:, :, :60]
    assert base_of_rows(rows.reshape(-1, model.columns)).rank == 16


def test_three_axes_with_a_locked_wrist_tell_fifteen() -> None:
    model = TorqueModel(arm_chain(), ())
    states = random_states(6, 200, RNG(2))
    for part in states[1:]:
        part[:, 3:] = 0.0
    states.q[:, 3:] = (0.3, -1.1, 0.7)
    rows = model.regressor(states)[:, :3].reshape(-1, model.columns)
    assert base_of_rows(rows).rank == 15


def test_wrist_torques_alone_lose_three_parameters() -> None:
    model = TorqueModel(arm_chain(), ())
    states = random_states(6, 300, RNG(3))
    rows = model.regressor(states)
    of_wrist = [column for column in range(60) if column >= 30]
    all_six = base_of_rows(rows[:, :, of_wrist].reshape(-1, 30)).rank
    wrist = base_of_rows(rows[:, 3:, of_wrist].reshape(-1, 30)).rank
    assert all_six - wrist == 3


def test_base_parameters_give_the_torques_of_all_parameters() -> None:
    model = TorqueModel(arm_chain())
    base, states = base_of(model), random_states(6, 50, RNG(4))
    theta = base.combination @ model.truth()
    torque = model.regressor(states)[:, :, base.columns] @ theta
    np.testing.assert_allclose(torque, model.torque(states, model.truth()), atol=1e-9)


def test_a_change_along_the_null_space_changes_no_torque() -> None:
    model = TorqueModel(arm_chain())
    base, states = base_of(model), random_states(6, 50, RNG(5))
    hidden = base.null_space() @ RNG(6).normal(size=model.columns - base.rank)
    assert np.abs(model.torque(states, hidden)).max() < 1e-8


def test_what_is_identifiable_is_said_parameter_by_parameter() -> None:
    model = TorqueModel(arm_chain(), ("viscous", "coulomb", "armature"))
    said = dict(zip(model.names, identifiable(base_of(model)), strict=True))
    assert said["m1"] == "no"
    assert said["fc4"] == "alone"
    assert said["Izz2"] == "combined"
    names = base_names(base_of(model), model.names)
    assert any(name.startswith("Izz2 + ") for name in names)
