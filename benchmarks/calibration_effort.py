"""`python -m benchmarks.calibration_effort`: error of the tool on the part for the touches spent on
calibrating."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.table import Row, print_rows
from polish_sim.dual import CALIBRATIONS
from polish_sim.dual.budget import TOGETHER, PairBudgetTrial, predict
from polish_sim.dual.calibrate import TcpTrial

EFFORTS = ((3, 0), (6, 0), (12, 0), (3, 3), (3, 6), (3, 12), (3, 24), (6, 12), (6, 24))
"""Marks on the part and closing touches."""
DRAWS = 40_000  # calibrations drawn of the covariances
MOVES, MINUTES_A_TOUCH = 3, 0.5
"""Moves of the tool along its axes; a touch by hand with a pointer, the way there included [min]."""


def main() -> None:
    asked = {claim.figure: claim.high for claim in CALIBRATIONS["budget"]}
    print_rows(
        "Tool on the part, by covariances: rms, and calibrations with more than is asked", _rows(asked)
    )


def _rows(asked: dict[str, float]) -> list[Row]:
    rows = []
    for marks, closing in EFFORTS:
        trial = PairBudgetTrial()
        trial = replace(trial, dual=replace(trial.dual, marks=marks, closing_touches=closing))
        prediction = predict(trial)
        C = prediction.covariances[TOGETHER]
        rms = float(np.sqrt(np.mean(np.trace(C, axis1=1, axis2=2))))
        x = np.random.default_rng(0).multivariate_normal(np.zeros(15), sum(prediction.shares.values()), DRAWS)
        off = np.einsum("pij,dj->dpi", prediction.slopes, x)
        each = np.sqrt(np.mean(np.sum(off**2, axis=2), axis=1))
        above = np.mean(each > asked["relative_error_rms_m"])
        touches = TcpTrial().poses * (1 + marks) + MOVES + closing
        what = (
            f"{marks} marks, {closing} closing touches: {touches} touches, "
            f"{MINUTES_A_TOUCH * touches:.0f} min"
        )
        rows.append(Row(what, f"{1e3 * rms:.4f} mm, {100.0 * above:.2f}%", "<= 0.06 mm, 2%"))
    return rows


if __name__ == "__main__":
    main()
