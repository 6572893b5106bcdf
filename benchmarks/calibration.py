"""`python -m benchmarks.calibration`: calibrations over many draws, beside their bounds."""

from __future__ import annotations

from polish_sim.kernel_cache import use_kernel_cache

use_kernel_cache()

import numpy as np  # noqa: E402 - the cache must be chosen before numba loads

from benchmarks.table import Row, print_rows  # noqa: E402
from polish_sim.calibration.tool import fit_tool_point, orientation_spread, point_error_bound  # noqa: E402
from polish_sim.experiments.arm_errors import ArmErrorTrial, run_arm_errors  # noqa: E402
from polish_sim.experiments.calibrate_base import BaseTrial, run_base_calibration  # noqa: E402
from polish_sim.experiments.calibrate_tcp import TcpTrial, planted_tool, simulate_touches  # noqa: E402
from polish_sim.experiments.error_budget import BudgetTrial, run_error_budget  # noqa: E402

TOUCH_DRAWS, BASE_SEEDS, ARM_SEEDS, BUDGET_DRAWS = 5000, 60, 20, 300


def main() -> None:
    print_rows(f"Tool point, {TOUCH_DRAWS} draws", _tool_rows())
    print_rows(f"Base frames from circles, {BASE_SEEDS} seeds", _base_rows())
    print_rows(f"Arms 0.5 mm and 0.02 deg off their table (std), {ARM_SEEDS} seeds", _arm_rows())
    print_rows(f"Follower's tip relative to the master's, {BUDGET_DRAWS} draws", _budget_rows())


def _tool_rows() -> list[Row]:
    rng, rows = np.random.default_rng(0), []
    for cone in (45.0, 62.0):
        trial = TcpTrial(cone=float(np.radians(cone)))
        T_flange_tool, squares = planted_tool(rng), []
        for _ in range(TOUCH_DRAWS):
            touches = simulate_touches(trial, T_flange_tool, rng).touches
            squares.append(np.sum((fit_tool_point(touches).point - T_flange_tool[:3, 3]) ** 2))
        rms, bound = float(np.sqrt(np.mean(squares))), point_error_bound(touches.R, trial.noise)
        best = trial.noise * float(np.sqrt(3.0 / trial.poses))
        what = f"10 touches, 0.05 mm, {cone:g} deg cone: "
        rows += [
            Row(what + "3D rms error", f"{1e3 * rms:.4f} mm", "<= 0.033 mm"),
            Row(what + "over Cramér-Rao bound", f"{rms / bound:.4f}", "<= 1.02"),
            Row(what + "bound over best possible", f"{bound / best:.4f}", "<= 1.05 from 62"),
            Row(what + "least spread", f"{orientation_spread(touches.R)[0][0]:.3f}", ">= 0.05"),
        ]
    return rows


def _base_rows() -> list[Row]:
    runs = [run_base_calibration(BaseTrial(seed=seed)) for seed in range(BASE_SEEDS)]

    def rms(name: str) -> float:
        return float(np.sqrt(np.mean([run.figures[name] ** 2 for run in runs])))

    return [
        Row("origin seen by the tracker, stated 3D std", f"{1e3 * rms('origin_std_m'):.4f} mm", "<= 0.017 mm"),
        Row("first axis, stated std", f"{np.degrees(rms('axis_std_rad')):.5f} deg", "<= 0.001 deg"),
        Row("origin, worse of two robots, rms error", f"{1e3 * rms('origin_error_m'):.4f} mm", ""),
        Row("follower's origin in the master's, rms error", f"{1e3 * rms('relative_origin_error_m'):.4f} mm", ""),
        Row("the same, stated", f"{1e3 * rms('relative_origin_std_m'):.4f} mm", ""),
    ]


def _arm_rows() -> list[Row]:
    results = np.array([run_arm_errors(ArmErrorTrial(seed=seed)) for seed in range(ARM_SEEDS)])
    rms, worst = 1e3 * np.sqrt(np.mean(results**2, axis=0)), 1e3 * results.max(axis=0)
    return [
        Row("relative tool point, tables taken as nominal, rms", f"{rms[0]:.3f} mm", ""),
        Row("the same after the joint calibration, rms", f"{rms[1]:.4f} mm", "<= 0.15 mm"),
        Row("the same, worst seed", f"{worst[1]:.4f} mm", "<= 0.15 mm"),
    ]


def _budget_rows() -> list[Row]:
    budget = run_error_budget(BudgetTrial(draws=BUDGET_DRAWS))
    rows = [
        Row(f"{name}: drawn, stated", f"{1e3 * share.drawn:.4f}, {1e3 * share.stated:.4f} mm", "")
        for name, share in budget.shares.items()
    ]
    rows.append(Row("all, rms", f"{1e3 * budget.shares['all'].drawn:.4f} mm", "<= 0.06 mm"))
    return [*rows, Row("all, 95% below", f"{1e3 * budget.p95:.4f} mm", "<= 0.10 mm")]


if __name__ == "__main__":
    main()
