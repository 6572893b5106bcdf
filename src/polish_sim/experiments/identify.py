"""Experiment ``identify``: the arm moves so that its torques tell its dynamics, and they are told (layer 9)."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell import Observer, Silent
from polish_sim.experiments import first_steps
from polish_sim.experiments.first_steps import FirstStep
from polish_sim.experiments.identified_arm import Arm, believe, build_arm, motion_limits, play_motion
from polish_sim.experiments.identified_payload import Weighed, guessed_load, weigh_block
from polish_sim.identification.base_parameters import BaseParameters, base_of
from polish_sim.identification.coloured_noise import estimate_widened
from polish_sim.identification.estimate import Estimate, estimate, held_out_error, require_rank
from polish_sim.identification.excitation import (
    Excitation,
    ExcitationTask,
    allowed_motions,
    design,
    mean_information,
    use_matrix,
)
from polish_sim.identification.fourier import FourierMotion
from polish_sim.identification.information import JointSums, information, inverse_of, sum_samples, told_rows
from polish_sim.identification.objectives import OBJECTIVES, condition_number
from polish_sim.identification.physical import Drawing, fit_consistent, is_consistent
from polish_sim.identification.robot_log import periodic_states, with_noise
from polish_sim.identification.settings import IdentifySettings
from polish_sim.identification.stepwise import carried, fit_motion_after
from polish_sim.identification.torque_model import States, TorqueModel

Array = NDArray[np.float64]

USE_MOTIONS = 12
"""Random motions under the same limits: what the identified model is designed to predict."""
USE_SAMPLES = 200


class HeldOut(NamedTuple):
    """A motion that was not fitted."""

    time: Array
    states: States
    measured: Array
    """Torques with noise [N m], NaN where a torque tells nothing, shape (m, n)."""
    exact: Array
    """Without noise [N m], shape (m, n); the measured ones if nobody knows better."""


@dataclass(frozen=True)
class Identification:
    """What an identification leaves behind."""

    model: TorqueModel
    base: BaseParameters
    found: Estimate
    full: Array
    """Physically consistent parameters, shape (p,)."""
    drawing: Drawing
    held_out: HeldOut
    figures: dict[str, Any]
    """The keys of metrics.json."""
    truth: Array | None = None
    """True base parameters, shape (r,); None for a real robot."""
    motion: FourierMotion | None = None
    weighed: Weighed | None = None
    """The payload, if one was to be found."""


def run_identification(
    settings: IdentifySettings, observer: Observer | None = None, use: States | None = None
) -> Identification:
    """Design an exciting motion, play it on the simulated arm, and identify the arm from what is measured.

    Args:
        settings: Noise, objective, method.
        observer: Told of the progress.
        use: Motion the identified model is for; random motions under the same limits if None.

    Returns:
        Parameters, figures against the truth, and a held-out motion.
    """
    observer = observer or Silent()
    streams = [np.random.default_rng(child) for child in np.random.SeedSequence(settings.seed).spawn(6)]
    observer.stage("read the arm")
    arm = build_arm(settings.terms)
    base, sigma = base_of(arm.truth), np.array(settings.sigma)
    drawing = believe(arm, streams[0])
    observer.stage(f"design a motion ({settings.objective})")
    task, other, excitation, design_s = _design(arm, base, drawing, settings, streams[1], use)
    observer.stage(f"play {settings.periods} periods and one of another motion")
    log = with_noise(
        play_motion(arm, excitation.motion, settings.periods, settings.rate), settings.encoder, sigma, streams[2]
    )
    held_out = _hold_out(arm, other, settings, streams[3])
    first = None
    if settings.method in first_steps.SIMULATED:
        observer.stage(f"first step ({settings.method})")
        first = first_steps.SIMULATED[settings.method](arm, task, settings, streams[4])
    observer.stage("estimate")
    started = time.process_time()
    states = periodic_states(log, excitation.motion.period)
    sums = sum_samples(arm.truth, base, states, log.torque)
    require_rank(sums, base, arm.truth)
    earlier = None if first is None else carried(first.step, base)
    found = estimate_widened(arm.truth, base, sums, states, log.torque, earlier)
    step_figures = {} if first is None else compare_steps(arm.truth, base, sums, first, held_out)
    fit_s = time.process_time() - started
    full = fit_consistent(arm.truth, base, found, drawing)
    truth = base.combination @ arm.truth.truth()
    figures = measure_fit(arm.truth, base, found, full, drawing, held_out) | step_figures
    told = information(sums, sigma)
    if first is not None:
        told = told + information(first.sums, first.sigma)
    figures |= _against_truth(found, told, truth) | _motion_figures(task, excitation, len(log.time))
    figures |= {"design_s": design_s, "fit_s": fit_s, "samples": len(log.time), "seed": settings.seed}
    figures |= {"method": settings.method, "objective": settings.objective}
    weighed = None
    if settings.payload:
        observer.stage(f"play {settings.periods} periods with a payload")
        weighed = weigh_block(sums, base, excitation.motion, settings, streams[5])
        figures |= weighed.figures
    return Identification(arm.truth, base, found, full, drawing, held_out, figures, truth, excitation.motion, weighed)


class Designed(NamedTuple):
    """A motion, the task it is for, and another motion of that kind to be held out."""

    task: ExcitationTask
    other: FourierMotion
    excitation: Excitation
    seconds: float


def _design(
    arm: Arm, base: BaseParameters, drawing: Drawing, settings: IdentifySettings, rng: np.random.Generator,
    use: States | None,
) -> Designed:  # fmt: skip
    sigma = np.array(settings.sigma)
    started = time.process_time()
    nothing, believed = np.eye(base.rank), drawing.parameters.copy()
    if settings.payload:
        last = 10 * arm.truth.joints
        believed[last - 10 : last] += guessed_load(settings.payload, arm.truth.chain.origins[-1])
    task = ExcitationTask(arm.truth, base, believed, sigma, motion_limits(), nothing, arm.near)
    other, *motions = islice(allowed_motions(task, rng), USE_MOTIONS + 1)
    t = np.arange(USE_SAMPLES) / USE_SAMPLES * other.period
    uses = [motion(t) for motion in motions] if use is None else [use]
    task = replace(task, use=np.mean([use_matrix(arm.truth, base, states, sigma) for states in uses], axis=0))
    choice = OBJECTIVES[settings.objective]
    excitation = design(task, choice, rng, settings.starts, settings.iterations)
    return Designed(task, other, excitation, time.process_time() - started)


def _hold_out(arm: Arm, motion: FourierMotion, settings: IdentifySettings, rng: np.random.Generator) -> HeldOut:
    log = play_motion(arm, motion, 1, settings.rate)
    states = periodic_states(log, motion.period)
    measured = with_noise(log, 0.0, np.array(settings.sigma), rng).torque
    # Where any joint turns round, the engine's friction has no sign; torques of moving joints are compared.
    moving = np.all(told_rows(states), axis=1)
    return HeldOut(log.time[moving], states.rows(moving), measured[moving], log.torque[moving])


def compare_steps(
    model: TorqueModel, base: BaseParameters, sums: JointSums, first: FirstStep, held_out: HeldOut
) -> dict[str, Any]:
    """How far a fit in two steps is from fitting everything at once, noise taken as white in both."""
    stepwise = fit_motion_after(first.step, base, sums)
    # Readings of the first step may be means over many samples: each has that step's own noise.
    joint = estimate(sums.plus(first.sums.weighed(first.step.found.sigma / estimate(sums).sigma)))
    errors = [
        np.sqrt(np.mean(held_out_error(model, base, theta, held_out.states, held_out.exact) ** 2))
        for theta in (stepwise.theta, joint.theta)
    ]
    return {
        "first_step_parameters": first.step.base.rank,
        "stepwise_over_joint": float(errors[0] / errors[1]),
        "stepwise_from_joint_std": float(np.abs((stepwise.theta - joint.theta) / joint.std).max()),
    }


def measure_fit(
    model: TorqueModel, base: BaseParameters, found: Estimate, full: Array, drawing: Drawing, held_out: HeldOut
) -> dict[str, Any]:
    """Figures every identification has; held-out errors are rms error / range of the torque, joint by joint."""

    def error(theta: Array) -> Array:
        return held_out_error(model, base, theta, held_out.states, held_out.exact)

    nrms, consistent = error(found.theta), error(base.combination @ full)
    links = full[: 10 * model.joints].reshape(-1, 10)
    off = model.regressor(held_out.states)[:, :, base.columns] @ found.theta - held_out.measured
    return {
        "base_parameters": base.rank,
        "condition": found.condition,
        "condition_scaling": "stacked regressor of the base columns, SI units, as measured",
        "condition_equilibrated": found.condition_equilibrated,
        "nrms_heldout": nrms.tolist(),
        "nrms_heldout_mean": float(nrms.mean()),
        "nrms_heldout_consistent_mean": float(consistent.mean()),
        "nrms_heldout_drawing_mean": float(error(base.combination @ drawing.parameters).mean()),
        "residual_over_noise_heldout": (np.sqrt(np.nanmean(off**2, axis=0)) / found.sigma).tolist(),
        "physically_consistent": is_consistent(links),
        "r_squared": found.r_squared.tolist(),
        "torque_noise_nm": found.sigma.tolist(),
        "torque_noise_inefficiency": None if found.inefficiency is None else found.inefficiency.tolist(),
    }


def _against_truth(found: Estimate, told: Array, truth: Array) -> dict[str, Any]:
    bound = np.diag(inverse_of(told))
    return {
        "error_over_crb": float(np.sqrt(np.mean((found.theta - truth) ** 2 / bound))),
        "interval_coverage": float(np.mean(found.covers(truth))),
    }


def _motion_figures(task: ExcitationTask, excitation: Excitation, samples: int) -> dict[str, Any]:
    """What the designed motion promises for a period of 10,000 samples, and its condition number in SI."""
    H = mean_information(task, excitation.motion)
    plain = mean_information(replace(task, sigma=np.ones_like(task.sigma)), excitation.motion)
    n = task.model.joints
    poses = excitation.motion(np.linspace(0.0, excitation.motion.period, 500)).q
    return {
        "predicted_error_sigma": float(np.sqrt(np.trace(np.linalg.solve(H, task.use)) / n / 1e4)),
        "predicted_error_sigma_here": float(np.sqrt(np.trace(np.linalg.solve(H, task.use)) / n / samples)),
        "condition_motion": condition_number(plain),
        "clearance_min_m": float(task.clearance(poses).distance.min()) if task.clearance else None,
        "design_evaluations": excitation.evaluations,
    }
