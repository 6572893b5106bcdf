"""How near identification comes to its bounds, over many draws:
`python -m benchmarks.identification [--PART]...`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.identification_peers import SAMPLES as SAMPLES_PEERS
from benchmarks.identification_peers import peer_rows
from benchmarks.identification_unmatched import SEEDS as SEEDS_UNMATCHED
from benchmarks.identification_unmatched import Known, covers, unmatched_lines
from benchmarks.table import Row, print_rows, words
from polish_sim.config import RobotConfig
from polish_sim.identification import IdentifySettings
from polish_sim.identification.arm import (
    SimulatedArm,
    believe,
    build_simulated_arm,
    motion_limits,
    play_motion,
)
from polish_sim.identification.estimate import (
    INTERVAL_95,
    base_of,
    condition_number,
    estimate,
    information,
    informative,
    inverse_of,
    sum_samples,
    torque_error,
)
from polish_sim.identification.excitation import (
    ExcitationTask,
    allowed_motions,
    design,
    mean_information,
    use_matrix,
)
from polish_sim.identification.identify import run_identification
from polish_sim.identification.log_file import periodic_states, with_noise
from polish_sim.identification.physical import fit_consistent, is_consistent
from polish_sim.identification.regressor import FULL, States, rigid_regressor
from polish_sim.models import robot_model_path

SEEDS, SEEDS_GEARS = 50, 20
FIRST_ELASTIC = 8460
SAMPLES = 10_000
CHUNK = 2000
DESIGNS = 5
"""Searches, every one from a random motion of its own."""
RANDOM = 20
SIGMA = np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])


def design_rows(terms: tuple[str, ...], label: str) -> Iterator[Row]:
    """Predicted error on motions that neither the design nor the fit has seen, over several starts."""
    task, held_out = prepared(terms)
    started = time.process_time()
    motions = [design(task, np.random.default_rng([1, seed])) for seed in range(DESIGNS)]
    seconds = (time.process_time() - started) / DESIGNS
    yield from motion_rows(task, held_out, motions, f"{label}, designed ({seconds:.1f} s each)", "<= 0.0285")
    drawn = allowed_motions(task, np.random.default_rng(2))
    yield from motion_rows(
        task, held_out, [next(drawn) for _ in range(RANDOM)], f"{label}, random motions", "-"
    )


def motion_rows(  # type: ignore[no-untyped-def]
    task, held_out, motions, label: str, limit: str
) -> Iterator[Row]:
    """Predicted errors and condition numbers of motions: median, least to largest."""
    errors = [predicted(task, held_out, motion) for motion in motions]
    plain = replace(task, sigma=np.ones(6))
    conditions = [condition_number(mean_information(plain, motion)) for motion in motions]
    spread = f"{np.median(errors):.4f} ({min(errors):.4f} to {max(errors):.4f})"
    yield Row(f"{label}: error / noise", spread, limit)
    yield Row(
        f"{label}: condition, SI",
        f"{np.median(conditions):.0f} ({min(conditions):.0f} to {max(conditions):.0f})",
        "-",
    )


def predicted(task, held_out, motion) -> float:  # type: ignore[no-untyped-def]
    """Rms error of predicted torques in units of noise after one period of a motion."""
    return float(np.sqrt(np.trace(np.linalg.solve(mean_information(task, motion), held_out)) / 6.0 / SAMPLES))


def _arm_with(terms: tuple[str, ...]) -> SimulatedArm:
    """The simulated arm, its torques made of these terms."""
    arm = build_simulated_arm()
    return replace(arm, truth=replace(arm.truth, terms=terms))


def prepared(terms: tuple[str, ...]):  # type: ignore[no-untyped-def]
    """The arm's task, and the mean information of twenty further random motions."""
    arm = _arm_with(terms)
    base, rng = base_of(arm.truth), np.random.default_rng(0)
    drawing = believe(arm, rng)
    task = ExcitationTask(
        arm.truth, base, drawing.parameters, SIGMA, motion_limits(), np.eye(base.rank), arm.clearance
    )  # fmt: skip
    drawn, t = allowed_motions(task, rng), np.arange(200) / 20.0
    uses = [use_matrix(arm.truth, base, next(drawn)(t), SIGMA) for _ in range(32)]
    return replace(task, use=np.mean(uses[:12], axis=0)), np.mean(uses[12:], axis=0)


def bound_rows(terms: tuple[str, ...]) -> Iterator[Row]:
    """Errors of many draws against the Cramer-Rao bound, intervals, bodies that can exist."""
    task, _held_out = prepared(terms)
    drawn = allowed_motions(task, np.random.default_rng(3))
    motion, other = next(drawn), next(drawn)
    t = np.arange(SAMPLES) * 10.0 / SAMPLES
    model, base = task.model, task.base
    arm, states, held = _arm_with(terms), motion(t), other(t[::10])
    truth, exact = model.truth(), model.torque(held, model.truth())
    torque, true_base = model.torque(states, truth), base.combination @ truth
    squares, covered, ratios, consistent, nrms = [], [], [], 0, []
    for seed in range(SEEDS):
        rng = np.random.default_rng([7, seed])
        sums = sum_samples(model, base, states, torque + rng.normal(size=torque.shape) * SIGMA)
        found = estimate(sums)
        squares.append((found.theta - true_base) ** 2)
        covered.append(covers(found, true_base))
        full = fit_consistent(model, base, found, believe(arm, rng))
        consistent += is_consistent(full[:60].reshape(6, 10))
        errors = [
            torque_error(model.torque(held, x, base.columns), exact)
            for x in (found.theta, base.combination @ full)
        ]
        ratios.append(np.linalg.norm(errors[1]) / np.linalg.norm(errors[0]))
        nrms.append(float(errors[0].mean()))
    bound = np.diag(inverse_of(information(sums, SIGMA)))
    yield Row(
        "rms error / Cramer-Rao bound", f"{np.sqrt(np.mean(np.mean(squares, axis=0) / bound)):.3f}", "<= 1.02"
    )
    yield Row("95% intervals that hold the truth", f"{100 * np.mean(covered):.1f}%", "93-97%")
    yield Row(
        "error held out / range, one period of a random motion", f"{100 * np.mean(nrms):.3f}%", "<= 0.13%"
    )
    yield Row("fits whose bodies can exist", f"{100 * consistent / SEEDS:.0f}%", "100%")
    yield Row("their error held out / that of the base parameters", f"{np.mean(ratios):.4f}", "<= 1.02")


def arm_rows() -> Iterator[Row]:
    """The same for the designed motion played on the simulated arm, whose friction is the engine's."""
    task, _held_out = prepared(FULL)
    motion = design(task, np.random.default_rng(1))
    other = next(allowed_motions(task, np.random.default_rng(4)))
    arm, encoder = build_simulated_arm(), IdentifySettings().encoder
    held = play_motion(arm, other, 1, 1000.0)
    held_states = periodic_states(held, other.period)
    # Near standstill the engine's friction has no size: moving joints are compared.
    exact = np.where(informative(held_states), held.torque, np.nan)
    for periods, limit in ((1, "<= 0.13%"), (5, "<= 0.06%")):
        log = with_noise(
            play_motion(arm, motion, periods, 1000.0), encoder, np.zeros(6), np.random.default_rng(0)
        )
        states = periodic_states(log, motion.period)
        true_base = task.base.combination @ task.model.truth()
        clean = estimate(sum_samples(task.model, task.base, states, log.torque), sigma=SIGMA)
        offs, covered, nrms = [], [], []
        for seed in range(SEEDS):
            noise = np.random.default_rng([9, seed]).normal(size=log.torque.shape) * SIGMA
            found = estimate(sum_samples(task.model, task.base, states, log.torque + noise))
            offs.append(found.theta - true_base)
            covered.append(covers(found, true_base))
            nrms.append(
                torque_error(task.model.torque(held_states, found.theta, task.base.columns), exact).mean()
            )
        std = clean.std
        draws = np.mean((np.array(offs) / std) ** 2, axis=1)
        ratio = float(np.sqrt(draws.mean()))
        doubt = float(draws.std() / np.sqrt(SEEDS) / 2.0 / ratio)
        bias = float(np.sqrt(np.mean(((clean.theta - true_base) / std) ** 2)))
        yield Row(f"{periods} periods: rms error / bound", f"{ratio:.3f} +- {doubt:.3f}", "<= 1.02")
        yield Row(f"{periods} periods: of it the engine, without noise", f"{bias:.3f}", "-")
        yield Row(f"{periods} periods: 95% intervals that hold", f"{100 * np.mean(covered):.1f}%", "93-97%")
        yield Row(f"{periods} periods: error held out / range", f"{100 * np.mean(nrms):.3f}%", limit)


def speed_rows() -> Iterator[Row]:
    """Regressor of one sample, and an identification of 25,000."""
    arm = build_simulated_arm()
    model, base = arm.truth, base_of(arm.truth)
    rng = np.random.default_rng(0)
    q, qd, qdd = (rng.uniform(-2.0, 2.0, (25_000, 6)) for _ in range(3))
    geometry = model.chain.geometry
    rigid_regressor(geometry, q[:10], qd[:10], qdd[:10])
    parts = [slice(first, first + CHUNK) for first in range(0, len(q), CHUNK)]

    def piecewise() -> None:
        for part in parts:
            rigid_regressor(geometry, q[part], qd[part], qdd[part])

    pieces = min(_timed(piecewise) for _ in range(5))
    whole = min(_timed(lambda: rigid_regressor(geometry, q, qd, qdd)) for _ in range(5))
    yield Row(
        f"regressor, one sample of {CHUNK:,} at a time, as fits take it",
        f"{1e6 * pieces / len(q):.2f} us",
        "<= 1 us",
    )
    yield Row("regressor, one sample of 25,000 at once (72 MB)", f"{1e6 * whole / len(q):.2f} us", "-")
    yield Row("pinocchio's regressor of this robot, one sample", f"{1e6 * _pinocchio_seconds():.2f} us", "-")
    states = States(q, qd, qdd)
    torque = model.torque(states, model.truth())
    best = min(_timed(lambda: estimate(sum_samples(model, base, states, torque))) for _ in range(3))
    yield Row("identification of 25,000 samples", f"{best:.2f} s", "<= 0.5 s")


def _pinocchio_seconds(samples: int = 5000) -> float:
    """Seconds a sample of pinocchio called from Python; it sees the head's slide as a seventh joint."""
    import pinocchio

    theirs = pinocchio.buildModelFromMJCF(str(robot_model_path()))
    data, draws = theirs.createData(), np.random.default_rng(0).uniform(-2.0, 2.0, (samples, 3, theirs.nv))

    def work() -> None:
        for q, qd, qdd in draws:
            pinocchio.computeJointTorqueRegressor(theirs, data, q, qd, qdd)

    return min(_timed(work) for _ in range(3)) / samples


def _timed(work) -> float:  # type: ignore[no-untyped-def]
    started = time.process_time()
    work()
    return time.process_time() - started


def unmatched() -> None:
    """Print the study of robots that are not what the model says."""
    task, _held_out = prepared(FULL)
    found = design(task, np.random.default_rng(1))
    other = next(allowed_motions(task, np.random.default_rng(4)))
    print(f"{SEEDS_UNMATCHED} draws each, designed motion, 58 parameters\n")
    for line in unmatched_lines(Known(task.model, task.base, SIGMA, found, other)):
        print(line, flush=True)


def against_figaroh() -> Iterator[Row]:
    """Ours and FIGAROH on the same samples of a random motion."""
    task, _held_out = prepared(FULL)
    drawn = allowed_motions(task, np.random.default_rng(3))
    fitted, other = next(drawn), next(drawn)
    t = np.arange(SAMPLES_PEERS) / SAMPLES_PEERS * fitted.period
    yield from peer_rows(task.model, SIGMA, fitted(t), other(t))


def gear_rows() -> Iterator[Row]:
    """Stiffness of the elastic arm's gears, arms and motions of many seeds, two periods each."""
    robot, errors, held, told = RobotConfig(arm="ur5e"), [], [], np.zeros((6, 3))
    for seed in range(SEEDS_GEARS):
        found = run_identification(IdentifySettings(periods=2, iterations=15, robot=robot, seed=seed)).gears
        assert found is not None
        K, std, true = (part[:, -3:] for part in found)
        told += np.isfinite(K)
        errors.append(np.abs(K - true) / true)
        held.append(np.where(np.isfinite(K), np.abs(K - true) <= INTERVAL_95 * std, np.nan))
    held, errors = np.array(held), np.array(errors)
    for k, name in enumerate(("below knee 1", "between the knees", "above knee 2")):
        spread = f"{100 * np.nanmedian(errors[:, :, k]):.1f}%, {100 * np.nanmax(errors[:, :, k]):.1f}%"
        joints = ", ".join(f"{100 * share / SEEDS_GEARS:.0f}%" for share in told[:, k])
        yield Row(f"{name}: found, joints 1 to 6", joints, "-")
        yield Row(f"{name}: error, median and largest", spread, "-")
        yield Row(f"{name}: 95% intervals that hold", f"{100 * np.nanmean(held[:, :, k]):.0f}%", "-")
    yield Row("all: 95% intervals that hold", f"{100 * np.nanmean(held):.1f}%", "-")


def elastic_rows() -> Iterator[Row]:
    """The default arm identified as it is, arms and motions of new seeds, five periods each."""
    runs = []
    for seed in range(FIRST_ELASTIC, FIRST_ELASTIC + SEEDS_GEARS):
        runs.append(run_identification(IdentifySettings(iterations=60, seed=seed)).figures)
        print(
            seed,
            [
                round(float(runs[-1][key]), 4)
                for key in ("nrms_heldout_mean", "error_over_crb", "interval_coverage")
            ],
            flush=True,
        )
    for key, label, share, asked in (
        ("nrms_heldout_mean", "error held out / range, mean of joints", 100.0, "<= 0.5%"),
        ("nrms_heldout_drawing_mean", "the same by the drawing", 100.0, "-"),
        ("error_over_crb", "error / Cramer-Rao bound", 1.0, "<= 1.5"),
        ("interval_coverage", "95% intervals that hold", 100.0, ">= 93%"),
    ):
        values = share * np.array([run[key] for run in runs])
        spread = f"{np.sqrt(np.mean(values**2)) if share == 1.0 else values.mean():.3f}"
        yield Row(label, f"{spread} ({values.min():.3f} to {values.max():.3f})", asked)
    rigid = 100.0 * np.array([run["nrms_rigid"] for run in runs])
    yield Row("torques without friction, by joint", ", ".join(f"{x:.2f}%" for x in rigid.mean(axis=0)), "-")
    yield Row(
        "the same, mean of joints", f"{rigid.mean():.3f}%, worst arm {rigid.mean(axis=1).max():.3f}%", "<= 1%"
    )


PARTS = {
    "--elastic": lambda: print_rows(f"The default arm, {SEEDS_GEARS} arms", elastic_rows()),
    "--speed": lambda: print_rows("Speed", speed_rows()),
    "--bounds": lambda: print_rows(f"Against the bounds, {SEEDS} draws, 58 parameters", bound_rows(FULL)),
    "--arm": lambda: print_rows(f"Designed motion on the simulated arm, {SEEDS} draws", arm_rows()),
    "--design-48": lambda: print_rows(
        "Design of motions", design_rows(("coulomb", "viscous"), "48 parameters")
    ),
    "--design-58": lambda: print_rows("Design of motions", design_rows(FULL, "58 parameters")),
    "--peers": lambda: print_rows("Beside FIGAROH, one tenth of a period's samples", against_figaroh()),
    "--unmatched": unmatched,
    "--gears": lambda: print_rows(f"Gears of the elastic arm, {SEEDS_GEARS} arms", gear_rows()),
}
"""What `python -m benchmarks.identification [--PART]...` measures."""


if __name__ == "__main__":
    wanted = words(__doc__) or list(PARTS)
    for name in wanted:
        PARTS[name]()
