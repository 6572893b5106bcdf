"""Identify an arm's dynamics from an exciting motion of the simulated arm, or from a robot's own log."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools
from polish_sim.cell import SILENT, Observer
from polish_sim.errors import IdentificationError
from polish_sim.identification import IdentifySettings
from polish_sim.identification.arm import (
    LoggedRobot,
    SimulatedArm,
    believe,
    build_simulated_arm,
    motion_limits,
    play_motion,
)
from polish_sim.identification.elastic import (
    BAND_HZ,
    PREDICTED_HZ,
    ElasticMotion,
    Found,
    elastic_base,
    fit_elastic,
    one_period,
)
from polish_sim.identification.estimate import (
    BaseParameters,
    Estimate,
    against_truth,
    base_of,
    condition_number,
    estimate_widened,
    information,
    informative,
    inverse_of,
    require_excited,
    sum_samples,
    torque_error,
)
from polish_sim.identification.excitation import (
    FREQUENCY,
    ExcitationTask,
    FourierMotion,
    allowed_motions,
    design,
    mean_information,
    use_matrix,
)
from polish_sim.identification.gear_fit import GearFit, fit_gears
from polish_sim.identification.log_file import RobotLog, periodic_states, with_noise
from polish_sim.identification.payload import Weighed, guessed_load, weigh_block
from polish_sim.identification.physical import Drawing, fit_consistent, is_consistent
from polish_sim.identification.regressor import FULL, States, TorqueModel

USE_MOTIONS = 12  #: Random motions under the same limits: what the identified model is designed to predict
USE_SAMPLES = 200
PERIOD = 1.0 / FREQUENCY  #: Of exciting motions [s]
HELD_OUT = 0.2  #: Share of a robot's own log, its end, that is not fitted


class HeldOut(NamedTuple):
    """A motion that was not fitted."""

    time: Array
    states: States
    measured: Array  #: Torques with noise [N m], NaN where a torque does not count, shape (m, n)
    exact: Array  #: Without noise [N m], shape (m, n); the measured ones of a real robot
    found: Array  #: Predicted by the estimate [N m], shape (m, n)
    consistent: Array  #: By bodies that can exist [N m], shape (m, n)
    drawn: Array  #: By the drawing [N m], shape (m, n)


@dataclass(frozen=True)
class Identification:
    """Result of an identification."""

    model: TorqueModel
    base: BaseParameters
    found: Estimate
    full: Array  #: Physically consistent parameters, shape (p,)
    drawing: Drawing
    held_out: HeldOut
    figures: dict[str, Any]  #: The keys of metrics.json
    truth: Array | None = None  #: True parameters, shape (p,); None for a real robot
    weighed: Weighed | None = None  #: The payload, if one was searched
    gears: GearFit | None = None  #: Of elastic joints


def run_identification(
    settings: IdentifySettings, observer: Observer = SILENT, use: States | None = None
) -> Identification:
    """Design an exciting motion, play it on the simulated arm, and identify the arm from what is measured.

    ``use``: motion the identified model is for; random motions under the same limits if None. Returns
    parameters, figures against the truth, and a held-out motion.
    """
    # The fifth is not used; without it the payload of a seed would be another.
    streams = [np.random.default_rng(child) for child in np.random.SeedSequence(settings.seed).spawn(6)]
    observer.stage("read the arm")
    arm = build_simulated_arm(settings.robot, settings.seed, warm_at=0.5 * settings.periods * PERIOD)
    base = base_of(arm.truth)
    sigma = np.array(settings.sigma)
    drawing = believe(arm, streams[0])
    observer.stage("design a motion")
    started = time.process_time()
    task, other, motion = _design(arm, base, drawing, settings, streams[1], use)
    design_s = time.process_time() - started
    observer.stage("play the motion, and another one to check with")
    log = with_noise(
        play_motion(arm, motion, settings.periods, settings.rate),
        settings.encoder_step,
        sigma,
        streams[2],
    )
    other_log = play_motion(arm, other, 1, settings.rate)
    observer.stage("estimate")
    started = time.process_time()
    states = periodic_states(log, motion.period)
    sums = sum_samples(arm.truth, base, states, log.torque)
    require_excited(sums, base, arm.truth)
    held = periodic_states(other_log, other.period)
    gears: GearFit | None = None
    truth = arm.truth.truth()
    if log.gears is not None:
        base, found, full, gears, against, predicted = _fit_elastic(arm, log, other_log, drawing, settings)
    else:
        found = estimate_widened(arm.truth, base, sums, states, log.torque)
        full = fit_consistent(arm.truth, base, found, drawing)
        bound = np.diag(inverse_of(information(sums, sigma)))
        against = against_truth(found.theta - base.combination @ truth, found.std, bound)
        predicted = Fitted(arm.truth, base, found).predicted(held, full, drawing)
    fit_s = time.process_time() - started
    held_out = _hold_out(other_log, held, predicted, sigma, streams[3])
    figures = measure_fit(arm.truth, base, found, full, held_out) | against
    figures["nrms_rigid"] = _rigid_error(arm.truth, full, held_out.states)
    if gears is not None:
        figures |= gears.figures()
    figures |= _motion_figures(task, motion)
    figures |= {"design_s": design_s, "fit_s": fit_s, "samples": len(log.time), "seed": settings.seed}
    weighed = None
    if settings.payload:
        observer.stage("play the motion with a payload")
        weighed = weigh_block(sums, task.base, motion, settings, streams[5])
        figures |= weighed.figures
    return Identification(
        arm.truth, base, found, full, drawing, held_out, figures, truth, weighed, gears,
    )  # fmt: skip


def _design(
    arm: SimulatedArm,
    base: BaseParameters,
    drawing: Drawing,
    settings: IdentifySettings,
    rng: np.random.Generator,
    use: States | None,
) -> tuple[ExcitationTask, FourierMotion, FourierMotion]:
    """The task of a motion, another random motion to be held out, and the motion designed for the task."""
    sigma = np.array(settings.sigma)
    nothing = np.eye(base.rank)
    believed = drawing.parameters.copy()
    if settings.payload:
        last = 10 * arm.truth.joints
        believed[last - 10 : last] += guessed_load(settings.payload, arm.truth.chain.origins[-1])
    task = ExcitationTask(arm.truth, base, believed, sigma, motion_limits(), nothing, arm.clearance)
    other, *motions = islice(allowed_motions(task, rng), USE_MOTIONS + 1)
    t = np.arange(USE_SAMPLES) / USE_SAMPLES * other.period
    uses = [motion(t) for motion in motions] if use is None else [use]
    task = replace(task, use=np.mean([use_matrix(arm.truth, base, states, sigma) for states in uses], axis=0))
    return task, other, design(task, rng, settings.starts, settings.iterations)


Predictions = tuple[Array, Array, Array]
"""Torques (m, n) [N m] by the estimate, by bodies that can exist, and by the drawing."""


class _FittedArm(NamedTuple):
    """An elastic arm identified, and what it says of the motion held out."""

    base: BaseParameters
    found: Estimate
    full: Array
    gears: GearFit
    against: dict[str, float]
    predicted: Predictions


def _fit_elastic(
    arm: SimulatedArm, log: RobotLog, other: RobotLog, drawing: Drawing, settings: IdentifySettings
) -> _FittedArm:
    """First the gears, whose error separates friction by load from the links' size; then links, rotors and
    friction."""
    gears = fit_gears(log, arm.robot.real, PERIOD)
    base = elastic_base(arm.truth)
    assert arm.known is not None
    motion_of = partial(ElasticMotion, arm.known, drawing.parameters, gears)
    mean = one_period(log, PERIOD)
    motion = motion_of(mean, BAND_HZ)
    fit = fit_elastic(motion, base, mean.torque, np.array(settings.sigma), settings.periods)
    full = fit_consistent(arm.truth, base, fit.estimate, drawing)
    held = motion_of(other, PREDICTED_HZ, sprung=True)
    nothing = Found(drawing.parameters, np.zeros_like(fit.numbers.loads), np.zeros_like(fit.numbers.bends))
    predicted = (
        held.torques(fit.numbers),
        held.torques(fit.numbers._replace(full=full)),
        held.torques(nothing),
    )
    gears = gears.with_loads(fit.numbers.loads, fit.loads_std)
    against = fit.against(base, arm.truth.truth(), gears.true_loads())
    return _FittedArm(base, fit.estimate, full, gears, against, predicted)


def _hold_out(
    log: RobotLog, states: States, predicted: Predictions, sigma: Array, rng: np.random.Generator
) -> HeldOut:
    measured = with_noise(log, 0.0, sigma, rng).torque
    # Where any joint reverses, the engine's friction has no sign; torques of moving joints are compared.
    moving = np.all(informative(states), axis=1)
    given = (torque[moving] for torque in predicted)
    return HeldOut(log.time[moving], states.rows(moving), measured[moving], log.torque[moving], *given)


def _rigid_error(model: TorqueModel, full: Array, states: States) -> Array:
    """Rms error / range of the torques without friction, of links and rotors (p,), shape (n,)."""
    kept = [model.names[k][:2] not in ("fc", "fv", "f0") for k in range(model.columns)]
    Y = model.regressor(states)[:, :, kept]
    return torque_error(Y @ full[kept], Y @ model.truth()[kept])


def measure_fit(
    model: TorqueModel, base: BaseParameters, found: Estimate, full: Array, held_out: HeldOut
) -> dict[str, Any]:
    """Figures every identification has; held-out errors are rms error / range of the torque, joint by
    joint."""
    nrms, consistent, drawn = (
        torque_error(given, held_out.exact) for given in (held_out.found, held_out.consistent, held_out.drawn)
    )
    links = full[: 10 * model.joints].reshape(-1, 10)
    off = held_out.found - held_out.measured
    return {
        "base_parameters": base.rank,
        "condition": found.condition,
        "condition_scaling": "stacked regressor of the base columns, SI units, as measured",
        "nrms_heldout": nrms,
        "nrms_heldout_mean": nrms.mean(),
        "nrms_heldout_consistent_mean": consistent.mean(),
        "nrms_heldout_drawing_mean": drawn.mean(),
        "residual_over_noise_heldout": (np.sqrt(np.nanmean(off**2, axis=0)) / found.sigma),
        "physically_consistent": is_consistent(links),
        "r_squared": found.r_squared,
        "torque_noise_nm": found.sigma,
        "torque_noise_inefficiency": found.inefficiency,
    }


def _motion_figures(task: ExcitationTask, motion: FourierMotion) -> dict[str, Any]:
    """What the designed motion promises for a period of 10,000 samples, and its condition number in SI."""
    plain = mean_information(replace(task, sigma=np.ones_like(task.sigma)), motion)
    spread = np.trace(np.linalg.solve(mean_information(task, motion), task.use)) / task.model.joints
    poses = motion(np.linspace(0.0, motion.period, 500)).q
    return {
        "predicted_error_sigma": np.sqrt(spread / 1e4),
        "condition_motion": condition_number(plain),
        "clearance_min_m": task.clearance(poses).distance.min(),
    }


def identify_from_log(robot: LoggedRobot, log: RobotLog, states: States) -> Identification:
    """Identify a robot from its own log and states; the last fifth of its motion is held out.

    Raises IdentificationError if the motion does not excite every base parameter.
    """
    started = time.process_time()
    cut = round(len(log.time) * (1.0 - HELD_OUT))
    fitted = slice(0, cut)
    model, base, found = fit = fit_samples(robot.model, states.rows(fitted), log.torque[fitted])
    drawing = Drawing(model.truth(), robot.carried)
    fit_s = time.process_time() - started
    counts = informative(states)
    counts[fitted] = False
    _require_moving(model, counts)
    full = fit_consistent(model, base, found, drawing)
    rows = np.any(counts, axis=1)
    held = states.rows(rows)
    measured = np.where(counts, log.torque, np.nan)[rows]
    held_out = HeldOut(log.time[rows], held, measured, measured, *fit.predicted(held, full, drawing))
    figures: dict[str, Any] = measure_fit(model, base, found, full, held_out)
    if model.load is not None:
        rigid = fit_samples(replace(model, terms=FULL, load=None), states.rows(fitted), log.torque[fitted])
        plain = torque_error(rigid.torque(held_out.states), held_out.measured)
        figures |= {"nrms_heldout_rigid": plain, "nrms_heldout_rigid_mean": plain.mean()}
    figures |= {"error_over_crb": None, "interval_coverage": None, "design_s": None, "fit_s": fit_s}
    figures |= {"samples": len(log.time)}
    return Identification(model, base, found, full, drawing, held_out, figures)


class Fitted(NamedTuple):
    """A torque model and what was found of it in samples."""

    model: TorqueModel
    base: BaseParameters
    found: Estimate

    def torque(self, states: States) -> Array:
        """Torques of states [N m], shape (m, n)."""
        return self.model.torque(states, self.found.theta, self.base.columns)

    def predicted(self, states: States, full: Array, drawing: Drawing) -> Predictions:
        """Torques of states by the estimate, by bodies that can exist ``full`` (p,), and by the drawing."""
        Y = self.model.regressor(states)
        return Y[:, :, self.base.columns] @ self.found.theta, Y @ full, Y @ drawing.parameters


def fit_samples(model: TorqueModel, states: States, torque: Array) -> Fitted:
    """Fit a model to states (m, n) and torques (m, n) [N m].

    Raises IdentificationError if they do not excite every base parameter.
    """
    base = base_of(model)
    sums = sum_samples(model, base, states, torque)
    require_excited(sums, base, model)
    return Fitted(model, base, estimate_widened(model, base, sums, states, torque))


def _require_moving(model: TorqueModel, counts: Bools) -> None:
    """Refuse a part held out that has no usable torque of a joint, by which torques count (m, n)."""
    silent = [joint for j, joint in enumerate(model.chain.joints) if not counts[:, j].any()]
    if silent:
        raise IdentificationError(
            f"the last fifth of the log, which is held out, has no usable torque of {', '.join(silent)}: the "
            "joint stands still or reverses there. Let every joint move until the end of the log."
        )
