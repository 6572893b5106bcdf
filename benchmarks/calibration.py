"""`python -m benchmarks.calibration`: calibrations over many draws, beside their bounds."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.table import Row, print_rows, words
from polish_sim.config import DualConfig
from polish_sim.dual.budget import TOGETHER, PairBudgetTrial, compare_shares, draw_errors, predict
from polish_sim.dual.calibrate import (
    ArmTrial,
    BaseTrial,
    TcpTrial,
    planted_tool,
    run_arm_calibration,
    run_base_calibration,
    run_tcp_calibration,
    simulate_touches,
)
from polish_sim.dual.calibration.tool import fit_tool_point, orientation_spread, point_error_bound

TOUCH_DRAWS, AXES_DRAWS, BASE_SEEDS, ARM_SEEDS, BUDGET_DRAWS = 5000, 1000, 300, 20, 300


def main() -> None:
    print_rows("Exact data: worst error of position and rotation", _exact_rows())
    print_rows(f"Tool point, {TOUCH_DRAWS} draws", _tool_rows())
    print_rows(f"Base frames from circles, {BASE_SEEDS} seeds", _base_rows())
    print_rows(f"Arms 0.5 mm and 0.02 deg off their table (std), {ARM_SEEDS} seeds", _arm_rows())
    print_rows(f"Tool on the part without closing touches, {BUDGET_DRAWS} draws", _budget_rows())


def _exact_rows() -> list[Row]:
    """Noise 0: what is left is rounding."""
    tool = run_tcp_calibration(TcpTrial(noise=0.0)).figures
    found = {"tool frame": (tool["position_error_m"], tool["rotation_error_rad"])}
    base = run_base_calibration(BaseTrial(noise=0.0)).figures
    found["bases"] = (base["relative_origin_error_m"], base["relative_rotation_error_rad"])
    pair = PairBudgetTrial(dual=DualConfig(tracker_noise_m=0.0, touch_noise_m=0.0), draws=1)
    off = float(np.abs(draw_errors(pair, 0)[TOGETHER]).max())
    rows = [Row(name, f"{m:.1e} m, {rad:.1e}", "1e-12") for name, (m, rad) in found.items()]
    return [*rows, Row("two robots adjusted together: tool on the part", f"{off:.1e} m", "1e-12")]


def _tool_rows() -> list[Row]:
    rng, rows = np.random.default_rng(0), []
    for cone in (45.0, 62.0):
        trial = TcpTrial(cone=float(np.radians(cone)))
        T_flange_tool, squares = planted_tool(rng), []
        for _ in range(TOUCH_DRAWS):
            touches = simulate_touches(trial, T_flange_tool, rng).touches
            squares.append(np.sum((fit_tool_point(touches).point - T_flange_tool[:3, 3]) ** 2))
        rms, bound = float(np.sqrt(np.mean(squares))), point_error_bound(touches[:, :3, :3], trial.noise)
        best = trial.noise * float(np.sqrt(3.0 / trial.poses))
        what = f"10 touches, 0.05 mm, {cone:g} deg cone: "
        rows += [
            Row(what + "3D rms error", f"{1e3 * rms:.4f} mm", "<= 0.033 mm"),
            Row(what + "over Cramér-Rao bound", f"{rms / bound:.4f}", "<= 1.02"),
            Row(what + "bound over best possible", f"{bound / best:.4f}", "<= 1.05 from 62"),
            Row(what + "least spread", f"{orientation_spread(touches[:, :3, :3])[0][0]:.3f}", ">= 0.05"),
        ]
    return [*rows, *_tool_axes_rows()]


def _tool_axes_rows() -> list[Row]:
    """Moves of 100 mm: errors about each axis of the tool over draws, the worst axis."""
    runs = [run_tcp_calibration(TcpTrial(seed=seed)) for seed in range(AXES_DRAWS)]
    turns = []
    for seed, run in enumerate(runs):
        true = planted_tool(np.random.default_rng([seed, 11]))[:3, :3]
        turns.append(Rotation.from_matrix(true.T @ run.found.T_flange_tool[:3, :3]).as_rotvec())
    drawn = float(np.sqrt(np.mean(np.square(turns), axis=0)).max())
    stated = max(run.figures["rotation_std_max_rad"] for run in runs)
    return [
        Row(
            f"tool axes, 100 mm moves, {AXES_DRAWS} draws: rms error",
            f"{np.degrees(drawn):.4f} deg",
            "<= 0.045 deg",
        ),
        Row("the same, stated, worst", f"{np.degrees(stated):.4f} deg", "<= 0.045 deg"),
    ]


def _base_rows() -> list[Row]:
    runs = [run_base_calibration(BaseTrial(seed=seed)) for seed in range(BASE_SEEDS)]

    def rms(name: str) -> float:
        return float(np.sqrt(np.mean([run.figures[name] ** 2 for run in runs])))

    return [
        Row(
            "origin seen by the tracker, stated 3D std", f"{1e3 * rms('origin_std_m'):.4f} mm", "<= 0.017 mm"
        ),
        Row("first axis, stated std", f"{np.degrees(rms('axis_std_rad')):.5f} deg", "<= 0.001 deg"),
        Row("a metre from the origin, stated 3D std", f"{1e3 * rms('point_std_1m_m'):.4f} mm", "<= 0.027 mm"),
        Row("origin, worse of two robots, rms error", f"{1e3 * rms('origin_error_m'):.4f} mm", ""),
        Row(
            "follower's origin in the master's, rms error",
            f"{1e3 * rms('relative_origin_error_m'):.4f} mm",
            "",
        ),
        Row("the same, stated", f"{1e3 * rms('relative_origin_std_m'):.4f} mm", ""),
    ]


def _arm_rows() -> list[Row]:
    figures = [run_arm_calibration(ArmTrial(seed=seed)).figures for seed in range(ARM_SEEDS)]
    results = np.array([[one["relative_error_nominal_m"], one["relative_error_m"]] for one in figures])
    rms, worst = 1e3 * np.sqrt(np.mean(results**2, axis=0)), 1e3 * results.max(axis=0)
    return [
        Row("relative tool point, tables taken as nominal, rms", f"{rms[0]:.3f} mm", ""),
        Row("the same after the joint calibration, rms", f"{rms[1]:.4f} mm", "<= 0.15 mm"),
        Row("the same, worst seed", f"{worst[1]:.4f} mm", "<= 0.15 mm"),
    ]


def _budget_rows() -> list[Row]:
    """Found one by one, without closing touches: bases by a tracker, tool and part by touches."""
    trial = PairBudgetTrial(dual=DualConfig(closing_touches=0), draws=BUDGET_DRAWS)
    draws = [draw_errors(trial, number) for number in range(trial.draws)]
    errors = {name: np.stack([one[name] for one in draws]) for name in draws[0]}
    shares = compare_shares(trial, predict(trial).covariances, errors)
    rows = [
        Row(
            f"{name}: drawn, stated",
            f"{1e3 * share.drawn_rms_m:.4f}, {1e3 * share.predicted_rms_m:.4f} mm",
            "",
        )
        for name, share in shares.items()
    ]
    whole = shares[TOGETHER]
    rows.append(Row("all, rms", f"{1e3 * whole.drawn_rms_m:.4f} mm", "<= 0.06 mm"))
    return [*rows, Row("all, 95% below", f"{1e3 * whole.drawn_p95_m:.4f} mm", "<= 0.10 mm")]


if __name__ == "__main__":
    words(__doc__)
    main()
