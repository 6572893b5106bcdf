"""Bases, tool and part adjusted to each other, and how large the remaining error is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi, chi2

from polish_sim.arrays import Array
from polish_sim.dual.budget import length_probability, length_quantile, quadratic_tail
from polish_sim.dual.calibration.pair import SOURCES, ClosingTouches, PairAdjustment, PairParts, adjust_pair
from polish_sim.spatial import apply, from_pose, inverse, transform

NOISE = 5e-5
T_MASTER_FOLLOWER = from_pose([-1.1, 0.02, 0.01, 0.1, -0.05, 3.0])
T_FLANGE_WORK = from_pose([0.01, -0.02, 0.12, 0.3, 0.2, -0.4])
TIP = np.array([0.01, -0.005, 0.19])
MARKS = np.array([[0.08, 0.0, 0.04], [-0.04, 0.07, 0.04], [-0.04, -0.07, 0.04], [0.0, 0.05, 0.0]])
COUNT = 12


def shape(size: int, rng: np.random.Generator, scale: float) -> Array:
    """A covariance that is stretched some way."""
    L = scale * (np.eye(size) + 0.4 * rng.uniform(-1.0, 1.0, (size, size)))
    return np.asarray(L @ L.T)


def true_parts(rng: np.random.Generator) -> PairParts:
    covariances = np.stack([shape(3, rng, 2e-5) for _ in MARKS])
    return PairParts(
        T_MASTER_FOLLOWER,
        shape(6, rng, 2e-5),
        TIP,
        shape(3, rng, 2e-5),
        apply(T_FLANGE_WORK, MARKS),
        covariances,
    )


def true_touches(rng: np.random.Generator) -> ClosingTouches:
    """The tip at the marks, both flanges turned anyhow."""
    mark = np.arange(COUNT) % len(MARKS)
    turns = Rotation.random(2 * COUNT, rng=rng).as_matrix()
    T_1 = transform(turns[:COUNT], rng.uniform(-0.6, 0.6, (COUNT, 3)))
    marks_master = np.einsum("nij,nj->ni", T_1[:, :3, :3], apply(T_FLANGE_WORK, MARKS)[mark]) + T_1[:, :3, 3]
    T_2 = transform(turns[COUNT:], apply(inverse(T_MASTER_FOLLOWER), marks_master) - turns[COUNT:] @ TIP)
    return ClosingTouches(T_1, T_2, mark)


def measured(
    parts: PairParts, closing: ClosingTouches, rng: np.random.Generator
) -> tuple[PairParts, ClosingTouches]:
    """The same with noise as its covariances say."""
    base = rng.multivariate_normal(np.zeros(6), parts.bases_covariance)
    turn = Rotation.from_rotvec(base[3:]).as_matrix()
    T = transform(turn @ T_MASTER_FOLLOWER[:3, :3], T_MASTER_FOLLOWER[:3, 3] + base[:3])
    marks = parts.marks_flange + np.stack(
        [rng.multivariate_normal(np.zeros(3), C) for C in parts.marks_covariance]
    )
    tip = rng.multivariate_normal(TIP, parts.tip_covariance)
    T_2 = closing.T_follower_flange.copy()
    T_2[:, :3, 3] += NOISE * rng.standard_normal((COUNT, 3))
    return parts._replace(T_master_follower=T, tip=tip, marks_flange=marks), closing._replace(
        T_follower_flange=T_2
    )


def unknowns(found: PairAdjustment) -> Array:
    """Error of all 15 unknowns."""
    turns = [
        Rotation.from_matrix(T[:3, :3] @ true[:3, :3].T).as_rotvec()
        for T, true in ((found.T_master_follower, T_MASTER_FOLLOWER), (found.T_flange_work, T_FLANGE_WORK))
    ]
    return np.concatenate(
        [
            found.T_master_follower[:3, 3] - T_MASTER_FOLLOWER[:3, 3], turns[0], found.tip - TIP,
            found.T_flange_work[:3, 3] - T_FLANGE_WORK[:3, 3], turns[1],
        ]
    )  # fmt: skip


def test_exact_touches_put_a_wrong_base_right() -> None:
    """The base is believed 1 mm and 1 mrad off, and said to be: the touches alone decide, the rest is
    exact."""
    rng = np.random.default_rng(1)
    parts = true_parts(rng)
    wrong = parts._replace(
        T_master_follower=from_pose([0.0, 1e-3, 0.0, 1e-3, 0.0, 0.0]) @ T_MASTER_FOLLOWER,
        bases_covariance=np.eye(6),
        tip_covariance=np.zeros((3, 3)),
        marks_covariance=np.zeros((len(MARKS), 3, 3)),
    )
    found = adjust_pair(wrong, MARKS, true_touches(rng), 1e-9)
    assert np.abs(unknowns(found)).max() < 1e-10


def test_it_is_the_least_squares_of_an_independent_solver() -> None:
    """The same residuals written down in another way and left to scipy's finite differences."""
    rng = np.random.default_rng(3)
    parts, closing = measured(true_parts(rng), true_touches(rng), rng)

    def chain(x: Array) -> tuple[Array, Array, Array]:
        T_mf = from_pose([*x[:3], *x[3:6]])
        return T_mf, x[6:9], from_pose([*x[9:12], *x[12:15]])

    def residuals(x: Array) -> Array:
        T_mf, tip, T_fw = chain(x)
        turn = Rotation.from_matrix(T_mf[:3, :3] @ parts.T_master_follower[:3, :3].T).as_rotvec()
        base = np.r_[T_mf[:3, 3] - parts.T_master_follower[:3, 3], turn]
        rows = [np.linalg.solve(np.linalg.cholesky(parts.bases_covariance), base)]
        rows.append(np.linalg.solve(np.linalg.cholesky(parts.tip_covariance), tip - parts.tip))
        for m, seen, C in zip(MARKS, parts.marks_flange, parts.marks_covariance, strict=True):
            rows.append(np.linalg.solve(np.linalg.cholesky(C), apply(T_fw, m[None])[0] - seen))
        for T_1, T_2, k in zip(closing.T_master_flange, closing.T_follower_flange, closing.mark, strict=True):
            ends = apply(T_mf @ T_2, tip[None]) - apply(T_1 @ T_fw, MARKS[k : k + 1])
            rows.append(ends[0] / NOISE)
        return np.concatenate(rows)

    start = np.concatenate(
        [
            T_MASTER_FOLLOWER[:3, 3], Rotation.from_matrix(T_MASTER_FOLLOWER[:3, :3]).as_rotvec(), TIP,
            T_FLANGE_WORK[:3, 3], Rotation.from_matrix(T_FLANGE_WORK[:3, :3]).as_rotvec(),
        ]
    )  # fmt: skip
    T_mf, tip, T_fw = chain(
        least_squares(residuals, start, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    )
    found = adjust_pair(parts, MARKS, closing, NOISE)
    np.testing.assert_allclose(found.T_master_follower, T_mf, atol=2e-8)
    np.testing.assert_allclose(found.tip, tip, atol=2e-8)
    np.testing.assert_allclose(found.T_flange_work, T_fw, atol=2e-8)


def test_errors_are_the_cramer_rao_bound_and_each_source_adds_its_share() -> None:
    """Whitened errors of 400 draws have variance 1: a chi-square of 15 x 400 is known to 1.8%."""
    rng = np.random.default_rng(4)
    parts, closing = true_parts(rng), true_touches(rng)
    draws = [measured(parts, closing, rng) for _ in range(400)]
    errors = np.stack([unknowns(adjust_pair(noisy, MARKS, touches, NOISE)) for noisy, touches in draws])
    exact = adjust_pair(parts, MARKS, closing, NOISE)
    white = np.linalg.solve(np.linalg.cholesky(exact.covariance), errors.T)
    assert np.mean(white**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / white.size))
    assert np.abs(np.mean(white, axis=1)).max() < 4.5 / np.sqrt(400.0)
    shares = np.sum([exact.share(name) for name in SOURCES], axis=0)
    np.testing.assert_allclose(shares, exact.covariance, rtol=1e-6, atol=1e-18)


@pytest.mark.parametrize(
    ("variances", "freedoms"),
    [((1.0, 1.0, 1.0), 3), ((1.0, 1.0, 0.0), 2), ((0.0, 1.0, 0.0), 1), ((0.0, 0.0, 0.0), 0)],
)
def test_errors_alike_in_some_directions_are_a_chi_with_as_many_degrees_of_freedom(
    variances: tuple[float, ...], freedoms: int
) -> None:
    covariances = 1e-10 * np.diag(variances)[None]
    truth = chi(freedoms, scale=1e-5) if freedoms else None
    wanted = truth.ppf(0.95) if truth else 0.0
    assert length_quantile(covariances, 0.95) == pytest.approx(wanted, rel=1e-5)
    if freedoms == 3:
        lengths = np.linspace(0.0, 1e-4, 9)
        np.testing.assert_allclose(length_probability(covariances, lengths), truth.cdf(lengths), atol=1e-12)


def test_errors_of_several_places_are_what_is_drawn_of_them() -> None:
    """A turned, uneven covariance and a small one; a million draws determine a share of 0.95 to 0.0002."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((2, 3, 3)) * np.array([1e-5, 2e-6])[:, None, None]
    drawn = np.concatenate([rng.standard_normal((500_000, 3)) @ one.T for one in root])
    covariances = root @ np.swapaxes(root, 1, 2)
    quantile = length_quantile(covariances, 0.95)
    assert np.mean(np.linalg.norm(drawn, axis=1) <= quantile) == pytest.approx(0.95, abs=8e-4)


def test_a_sum_of_equal_squares_is_a_chi_square_and_of_unequal_ones_what_draws_say() -> None:
    weight = np.diag([2.0, 2.0, 2.0, 2.0])
    for limit in (1.0, 8.0, 30.0):
        assert quadratic_tail(0.5 * np.eye(4), weight, limit) == pytest.approx(chi2.sf(limit, 4), abs=1e-8)
    rng = np.random.default_rng(0)
    L = rng.uniform(-1.0, 1.0, (5, 5))
    squares = np.sum((L @ rng.standard_normal((5, 40_000))) ** 2, axis=0)
    limit = float(np.percentile(squares, 80.0))
    assert quadratic_tail(L @ L.T, np.eye(5), limit) == pytest.approx(0.2, abs=4.0 * np.sqrt(0.16 / 40_000))
    assert quadratic_tail(np.zeros((5, 5)), np.eye(5), 1.0) == 0.0
