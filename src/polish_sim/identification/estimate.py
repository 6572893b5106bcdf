"""Base parameters of a torque model, and their weighted least-squares estimate with covariance.

Base parameters are the identifiable combinations of parameters. Columns of stacked regressors are taken
in a fixed order; one that the earlier ones can make joins them in combination: W_dependent = W_base K,
theta = pi_base + K pi_dependent (paper 3). Samples are gathered as normal equations joint by joint, so that
the weights of the joints, their torque noise, can be found from the residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.signal import correlate

from polish_sim.arrays import Array, Bools, Indices, Uncertain, norms
from polish_sim.errors import IdentificationError
from polish_sim.identification.regressor import PIECE, States, TorqueModel, random_states

INDEPENDENT = 1e-8  #: A column is new if this share of its length stands off the earlier ones
#: Below this speed [rad/s] a joint's torque gets no weight: its friction has no known size
STANDSTILL = 0.1
#: While any joint is slower [rad/s] no torque gets weight: all feel how its friction reverses
TURNING = 0.06
STANDING = (0.01, 0.5)  #: Slower than this [rad/s], [rad/s^2], a joint stands: no friction reverses
INTERVAL_95 = 1.959964  #: Half width of a 95% interval in standard deviations
LONGEST = 0.1  #: Correlations are followed over this share of the samples at most
_SAMPLES = 200
_CLEAN = 1e-9
_ROUNDS = 4
#: Share of the scaled regressor's largest singular value below which a direction is hidden
_HIDDEN = 1e-5


class BaseParameters(NamedTuple):
    """Which columns stand for the rest."""

    columns: Indices  #: Columns of the regressor that are kept, shape (r,)
    combination: Array  #: theta = combination @ pi, identity on the kept columns, shape (r, p)

    @property
    def rank(self) -> int:
        """Number of base parameters r."""
        return len(self.columns)

    def null_space(self) -> Array:
        """Orthonormal directions of pi without any effect on torques, shape (p, p - r)."""
        return np.linalg.svd(self.combination)[2][self.rank :].T


def base_of(model: TorqueModel) -> BaseParameters:
    """Base parameters of a model that may move freely."""
    states = random_states(model.joints, _SAMPLES, np.random.default_rng(0))
    return base_of_rows(model.regressor(states).reshape(-1, model.columns))


def base_of_rows(W: Array) -> BaseParameters:
    """Base parameters of stacked regressor rows (rows, p)."""
    R: Array = np.asarray(np.linalg.qr(W, mode="r"))
    size = np.linalg.norm(R, axis=0)
    least = INDEPENDENT * size.max(initial=0.0)
    kept: list[int] = []
    basis = np.zeros((R.shape[0], 0))
    for column in np.flatnonzero(size > least):
        rest = R[:, column] / size[column]
        for _twice in range(2):
            rest = rest - basis @ (basis.T @ rest)
        length = np.linalg.norm(rest)
        if length > INDEPENDENT:
            kept.append(int(column))
            basis = np.column_stack([basis, rest / length])
    columns = np.array(kept, dtype=np.int64)
    scaled = R[:, columns] / size[columns]
    combination = np.linalg.lstsq(scaled, R, rcond=None)[0] / size[columns][:, None]
    combination[np.abs(combination) < _CLEAN] = 0.0
    combination[:, columns] = np.eye(len(columns))
    return BaseParameters(columns, combination)


def base_names(base: BaseParameters, names: Sequence[str]) -> tuple[str, ...]:
    """Write every base parameter as a sum of the p named parameters: ``Izz2 + 0.181 m3 + ...``."""
    return tuple(_sum(row, column, names) for row, column in zip(base.combination, base.columns, strict=True))


def _sum(row: Array, own: int, names: Sequence[str]) -> str:
    text = names[own]
    for column in map(int, np.flatnonzero(row)):
        if column != own:
            size = "" if abs(abs(row[column]) - 1.0) < _CLEAN else f"{abs(row[column]):.4g} "
            text += f" {'-' if row[column] < 0 else '+'} {size}{names[column]}"
    return text


def identifiable(base: BaseParameters) -> tuple[str, ...]:
    """Whether each parameter is identifiable: ``alone``, ``combined`` with others, or ``no``; shape (p,)."""
    hidden = norms(base.null_space())
    seen = np.linalg.norm(base.combination, axis=0) > _CLEAN
    return tuple(
        "no" if not some else "alone" if off < 1e-7 else "combined"
        for some, off in zip(seen, hidden, strict=True)
    )


class JointSums(NamedTuple):
    """Sums over samples for each of n joints and r base parameters."""

    squares: Array  #: Y_j^T Y_j, shape (n, r, r)
    products: Array  #: Y_j^T tau_j, shape (n, r)
    torque_sum: Array  #: Sum of tau_j, shape (n,)
    torque_squares: Array  #: Sum of tau_j^2, shape (n,)
    samples: Array  #: Samples that count, shape (n,)

    @property
    def torque_rms(self) -> Array:
        """Rms of each joint's torque [N m], shape (n,)."""
        return np.sqrt(np.maximum(self.torque_squares, 1e-12) / np.maximum(self.samples, 1.0))


def sum_samples(model: TorqueModel, base: BaseParameters, states: States, torque: Array) -> JointSums:
    """Gather the normal equations of measured states (m, n) and torques (m, n) [N m], joint by joint."""
    n, r = model.joints, base.rank
    squares = np.zeros((n, r, r))
    products = np.zeros((n, r))
    moving = informative(states)
    for first in range(0, len(torque), PIECE):
        rows = slice(first, first + PIECE)
        Y = model.regressor(states.rows(rows))[:, :, base.columns] * moving[rows, :, None]
        for j in range(n):
            of_joint = np.ascontiguousarray(Y[:, j])
            squares[j] += of_joint.T @ of_joint
            products[j] += of_joint.T @ torque[rows, j]
    used = np.where(moving, torque, 0.0)
    return JointSums(squares, products, used.sum(0), (used**2).sum(0), moving.sum(0).astype(float))


def informative(states: States) -> Bools:
    """Which torques count: the joint moves, and no joint reverses; shape (m, n)."""
    speed = np.abs(states.qd)
    standing = (speed <= STANDING[0]) & (np.abs(states.qdd) <= STANDING[1])
    turning = (speed <= TURNING) & ~standing
    return (speed > STANDSTILL) & ~np.any(turning, axis=1)[:, None]


def information(sums: JointSums, sigma: Array) -> Array:
    """Fisher information of the base parameters at noise sigma (n,) [N m], shape (r, r)."""
    return np.tensordot(1.0 / sigma**2, sums.squares, axes=1)


def inverse_of(H: Array) -> Array:
    """Inverse of a positive definite matrix whose rows have very different units.

    Of an information matrix: the Cramér-Rao bound, the least covariance of an unbiased estimate.
    """
    scale = 1.0 / np.sqrt(np.diag(H))
    return np.linalg.inv(equilibrated(H)) * np.outer(scale, scale)


@dataclass(frozen=True)
class Estimate(Uncertain):
    """Base parameters found in measured torques."""

    theta: Array  #: Shape (r,)
    covariance: Array  #: Shape (r, r)
    sigma: Array  #: Torque noise found in the residuals [N m], shape (n,)
    r_squared: Array  #: Share of each torque's variance that is explained, shape (n,)
    condition: float  #: Of the stacked regressor as it stands, in SI units
    #: Samples worth one independent sample, (n,); None where noise is taken as white
    inefficiency: Array | None = None


def against_truth(off: Array, std: Array, bound: Array) -> dict[str, float]:
    """Figures of errors (r,) of what is estimated with standard deviations, against the bound on their
    variances."""
    over = np.sqrt(np.mean(off**2 / bound))
    return {"error_over_crb": over, "interval_coverage": np.mean(np.abs(off) <= INTERVAL_95 * std)}


def estimate(sums: JointSums, sigma: Array | None = None) -> Estimate:
    """Base parameters, covariance and noise from normal equations.

    The weights are the residuals' own noise, or ``sigma`` (n,), the torques' noise [N m], where it is known.
    """
    noise = sums.torque_rms if sigma is None else sigma
    for _round in range(_ROUNDS):
        covariance = inverse_of(information(sums, noise))
        theta = covariance @ np.tensordot(1.0 / noise**2, sums.products, axes=1)
        fitted = np.einsum("jrs,r,s->j", sums.squares, theta, theta)
        left = np.maximum(sums.torque_squares - 2.0 * sums.products @ theta + fitted, 0.0)
        if sigma is None:
            spent = np.sum(covariance * sums.squares, axis=(1, 2)) / noise**2
            noise = np.sqrt(np.maximum(left, 1e-24) / np.maximum(sums.samples - spent, 1.0))
    total = sums.torque_squares - sums.torque_sum**2 / np.maximum(sums.samples, 1.0)
    explained = 1.0 - left / np.maximum(total, 1e-30)
    return Estimate(theta, covariance, noise, explained, condition_number(sums.squares.sum(0)))


def spread_of_sums(scores: Array, blocks: Indices) -> Array:
    """Covariance (p, p) of the sum of scores (m, p) that may be alike within a block (m,) (sandwich)."""
    used, which = np.unique(blocks, return_inverse=True)
    sums = np.zeros((len(used), scores.shape[1]))
    np.add.at(sums, which, scores)
    few = len(used) / max(len(used) - scores.shape[1], 1)
    return few * sums.T @ sums


def condition_number(H: Array) -> float:
    """Condition number of the stacked regressor whose information is H."""
    values = np.linalg.eigvalsh(H)
    return float(np.sqrt(values[-1] / max(float(values[0]), 1e-300)))


def equilibrated(H: Array) -> Array:
    """A positive definite matrix with rows and columns scaled to a diagonal of ones; a row of zeros stays."""
    size = np.sqrt(np.diag(H))
    scale = 1.0 / np.where(size > 0.0, size, 1.0)
    return H * np.outer(scale, scale)


def require_excited(
    sums: JointSums, base: BaseParameters, model: TorqueModel, more: Sequence[str] = ()
) -> None:
    """Refuse samples that cannot identify all base parameters and what ``more`` the sums are of.

    Raises IdentificationError, naming joints that stood still and the parameters that stay unknown.
    """
    H = information(sums, np.maximum(sums.torque_rms, 1e-6))
    values, vectors = np.linalg.eigh(equilibrated(H))
    hidden = vectors[:, values <= _HIDDEN**2 * values[-1]]
    if not hidden.size:
        return
    names = [*(model.names[column] for column in base.columns), *more]
    unknown = [name for name, part in zip(names, norms(hidden), strict=True) if part > 1e-2]
    still = [model.chain.joints[j] for j in range(model.joints) if sums.samples[j] == 0]
    said = f" {', '.join(still)} did not move, or never faster than {STANDSTILL:g} rad/s." if still else ""
    raise IdentificationError(
        f"the motion excites {len(names) - hidden.shape[1]} of {len(names)} base parameters.{said} Not "
        f"identifiable, or only in combination: {', '.join(unknown)}. Move every joint, at different speeds, "
        "in different poses of the others."
    )


def torque_error(given: Array, exact: Array) -> Array:
    """Rms error of torques (m, n) [N m] / range of the exact ones, shape (n,); NaN is left out, and is given
    where they do not change."""
    off = given - exact
    reach = np.nanmax(exact, axis=0) - np.nanmin(exact, axis=0)
    reach[reach == 0.0] = np.nan
    return np.sqrt(np.nanmean(off**2, axis=0)) / reach


# Noise that is not white. The inefficiency g = 1 + 2 (rho_1 + rho_2 + ...) of the residuals' correlations is
# the number of samples worth one independent sample; covariances grow by it.


def estimate_widened(
    model: TorqueModel, base: BaseParameters, sums: JointSums, states: States, torque: Array
) -> Estimate:
    """Estimate base parameters with intervals that count correlations between successive residuals.

    ``states`` and ``torque`` [N m], (m, n): the samples of the normal equations in their order. Every joint's
    samples are weighed by its noise and inefficiency; ``sigma`` of the estimate is the noise alone.
    """
    found = estimate(sums)
    left = torque - model.torque(states, found.theta, base.columns)
    g = inefficiency(left, informative(states))
    return replace(estimate(sums, found.sigma * np.sqrt(g)), sigma=found.sigma, inefficiency=g)


def inefficiency(residuals: Array, counts: Bools) -> Array:
    """Number of samples worth one independent sample, joint by joint, at least 1, shape (n,).

    ``residuals`` (m, n) are in the order of time; ``counts`` (m, n) says which of them count.
    """
    most = max(int(LONGEST * len(residuals)), 2)
    return np.array([_of_joint(residuals[:, j], counts[:, j], most) for j in range(residuals.shape[1])])


def _of_joint(residual: Array, counts: Bools, most: int) -> float:
    if counts.sum() < 2:
        return 1.0
    mean = residual[counts].mean()
    pairs = _autocorrelation(counts.astype(float), most)
    products = _autocorrelation(np.where(counts, residual - mean, 0.0), most)
    rho = np.divide(products, pairs, out=np.zeros(most), where=pairs > 0.5)
    rho /= max(rho[0], 1e-300)
    # Sums of two neighbours fall steadily; where they are lost in the noise they are left out.
    two = rho[: most - most % 2].reshape(-1, 2).sum(axis=1)
    end = np.argmax(two <= 0.0) if np.any(two <= 0.0) else len(two)
    return max(2.0 * two[:end].sum() - 1.0, 1.0)


def _autocorrelation(values: Array, most: int) -> Array:
    """Sums of products with the values k samples later, k below ``most``."""
    return correlate(values, values, method="fft")[len(values) - 1 :][:most]
