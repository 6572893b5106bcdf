"""Figures of the elastic arm that are also measured on robots: ``python -m benchmarks.how_real``.

Compliance and first resonance are those of the linear model, which the simulated arm keeps within 2% and 5%
(``tests/cell/test_real_arm.py``); the spread of a pose is simulated: 30 visits, each from another side. ISO 9283's
repeatability comes from one side always; there hysteresis and friction do not show.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from benchmarks.table import Row, print_rows
from tests.cell.cells import Array
from tests.cell.elastic import FOLDED, HOME, SPRINGS_ONLY, STRETCHED, Joints, first_mode, joints_at, poses, tangents

VISITS, WAY_RAD, WAY_S, REST_S = 30, 0.15, 0.6, 0.4


def measure() -> Iterator[Row]:
    """Rows of the table in docs/how_real.md."""
    soft = [1e6 * np.linalg.eigvalsh(_compliance(joints_at(q, *SPRINGS_ONLY)))[-1] for q in poses(12)]
    yield Row("compliance at the tool, softest way, 12 poses", f"{min(soft):.0f} to {max(soft):.0f} um/N", "-")
    for name, q in (("stretched", STRETCHED), ("home", HOME), ("folded", FOLDED)):
        value = first_mode(joints_at(q, *SPRINGS_ONLY))[0]
        yield Row(f"first resonance, {name}", f"{value.imag / (2.0 * math.pi):.1f} Hz", "-")
    for name, settings in (("motor", []), ("link", ["robot.real.servo_side=link"])):
        spread = f"{1e3 * _spread(*settings):.3f} mm"
        yield Row(f"spread of a pose from 30 sides, servo on the {name} side", spread, "-")


def _compliance(joints: Joints) -> Array:
    """Of the tool point, gears and servos in series [m/N], shape (3, 3)."""
    J = joints.jacobian()
    return np.asarray(J @ np.diag(1.0 / tangents(joints) + 1.0 / joints.arm.kp) @ J.T)


def _spread(*settings: str) -> float:
    """Mean distance from the mean place and three times its standard deviation, as RP of ISO 9283 [m]."""
    joints, rng = joints_at(HOME, *settings), np.random.default_rng(0)
    ctrl, dt, places = joints.data.ctrl, joints.dt, []
    for _ in range(VISITS):
        away = rng.uniform(-WAY_RAD, WAY_RAD, 6)
        for outwards in (True, False):
            for t in np.arange(0.0, WAY_S, dt):
                share, rate = _smooth(t / WAY_S)
                ctrl[0:12:2] = HOME + away * (share if outwards else 1.0 - share)
                ctrl[1:12:2] = away * (rate if outwards else -rate) / WAY_S
                joints.go(dt)
        ctrl[0:12:2], ctrl[1:12:2] = HOME, 0.0
        places.append(joints.go(REST_S)["tool"][-1, :3])
    off = np.linalg.norm(np.array(places) - np.mean(places, axis=0), axis=1)
    return float(off.mean() + 3.0 * off.std(ddof=1))


def _smooth(share: float) -> tuple[float, float]:
    """A way from rest to rest over the unit of time, and its speed."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2), 30.0 * share**2 * (1.0 - share) ** 2


if __name__ == "__main__":
    print_rows("The elastic arm", measure())
