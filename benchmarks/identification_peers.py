"""FIGAROH beside ours, same samples, same noise: `python -m benchmarks.identification --peers`, if it is
installed.

FIGAROH is no dependency: `pip install figaroh` next to this package. It reads the robot through pinocchio;
its weighted least squares holds a matrix of all rows squared, so a tenth of a period's samples is what fits
into memory.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.table import Row
from polish_sim.identification.estimate import base_of, estimate, informative, sum_samples, torque_error
from polish_sim.identification.regressor import States, TorqueModel
from polish_sim.models import robot_model_path

Array = NDArray[np.float64]

SAMPLES = 1000
DRAWS = 5


class Peer(NamedTuple):
    """FIGAROH's functions and its robot."""

    robot: Any
    build: Callable[..., Array]
    base: Callable[..., Any]
    weighted: Callable[..., Array]


def peer_rows(model: TorqueModel, sigma: Array, fitted: States, other: States) -> Iterator[Row]:
    """Held-out errors and times of both, means over draws; only samples in which every joint moves."""
    peer = _figaroh()
    if peer is None:
        yield Row("FIGAROH", "not installed", "-")
        return
    fitted, other = (states.rows(np.all(informative(states), axis=1)) for states in (fitted, other))
    torque, exact = (model.torque(states, model.truth()) for states in (fitted, other))
    errors: dict[str, list[float]] = {"ours": [], "FIGAROH": []}
    seconds: dict[str, list[float]] = {"ours": [], "FIGAROH": []}
    for draw in range(DRAWS):
        measured = torque + np.random.default_rng([5, draw]).normal(size=torque.shape) * sigma
        started = time.process_time()
        base = base_of(model)
        found = estimate(sum_samples(model, base, fitted, measured))
        seconds["ours"].append(time.process_time() - started)
        errors["ours"].append(
            float(torque_error(model.torque(other, found.theta, base.columns), exact).mean())
        )
        started = time.process_time()
        theirs, rank = _theirs(peer, fitted, measured, other)
        seconds["FIGAROH"].append(time.process_time() - started)
        rms = np.sqrt(np.mean((theirs - exact) ** 2, axis=0))
        errors["FIGAROH"].append(float((rms / np.ptp(exact, axis=0)).mean()))
    yield Row("samples, base parameters ours and FIGAROH's", f"{len(torque)}, {base.rank} and {rank}", "-")
    for name in errors:
        yield Row(f"{name}: error held out / range", f"{100 * np.mean(errors[name]):.3f}%", "-")
        yield Row(f"{name}: regressor, base and fit, CPU", f"{np.median(seconds[name]):.3f} s", "-")


def _figaroh() -> Peer | None:
    try:
        from figaroh.identification.identification_tools import weigthed_least_squares
        from figaroh.tools.qrdecomposition import get_baseParams
        from figaroh.tools.regressor import build_regressor_basic
    except ImportError:
        return None
    import pinocchio

    whole = pinocchio.buildModelFromMJCF(str(robot_model_path()))
    # The head's slide is held, as ours holds it.
    arm = pinocchio.buildReducedModel(whole, [whole.njoints - 1], pinocchio.neutral(whole))
    robot = SimpleNamespace(model=arm, data=arm.createData())
    return Peer(robot, build_regressor_basic, get_baseParams, weigthed_least_squares)


def _theirs(peer: Peer, fitted: States, measured: Array, other: States) -> tuple[Array, int]:
    """FIGAROH's torques of the other motion, shape (m, n), and how many base parameters it fitted."""
    n = measured.shape[1]
    settings = {
        "has_friction": True,
        "has_actuator_inertia": True,
        "has_joint_offset": True,
        "is_joint_torques": True,
        "act_idxv": list(range(n)),
        "idx_tau_stop": [len(measured) * (k + 1) for k in range(n)],
    }
    W = peer.build(peer.robot, *fitted, settings)
    kept = np.flatnonzero(np.sum(W**2, axis=0) > 1e-6)
    _, _, columns = peer.base(W[:, kept], [str(k) for k in kept])
    chosen = kept[np.asarray(columns, dtype=np.int64)]
    tau = measured.T.ravel()
    first = np.linalg.lstsq(W[:, chosen], tau, rcond=None)[0]
    phi = peer.weighted(peer.robot, first, W[:, chosen], tau, W[:, chosen] @ first, settings)
    predicted = peer.build(peer.robot, *other, settings)[:, chosen] @ phi
    return predicted.reshape(n, -1).T, len(chosen)
