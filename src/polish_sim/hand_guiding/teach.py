"""Experiment ``teach``: a hand guides the arm without a force sensor in its loop (paper 3, fig. 6)."""

from __future__ import annotations

import fnmatch
import math
import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Figures, norms, rms
from polish_sim.cell import Observer
from polish_sim.config import Checked, GuideConfig, HandConfig
from polish_sim.errors import InputError, check_name
from polish_sim.experiments.free_space import ToolMotion, free_log
from polish_sim.experiments.result import PartOf, RunResult, free_figures
from polish_sim.hand_guiding.arm import (
    DIRECTIONS,
    HOME,
    believe_arm,
    guided_arm,
    hand_of,
    home_pose,
    joints_for,
    torque_arm,
)
from polish_sim.hand_guiding.cell import GuidingRun, HandMotion, run_guided
from polish_sim.hand_guiding.law import FADE_FROM, MODES
from polish_sim.log import APPROACH_PHASE, PROCESS_PHASE, RETRACT_PHASE, Trace
from polish_sim.planning.toolpath import arc_length

# What the hand does in `run teach`: holds, moves, holds, releases.


HOLD_S, RELEASE_S = 0.5, 0.3  #: The servos hold the arm this long, then release it during this time [s]
FAST_S, SLOW_S = 0.6, 1.0  #: Durations of the hand's move in paper 3's trial [s]
HELD, MOVING, OFF = (
    APPROACH_PHASE,
    PROCESS_PHASE,
    RETRACT_PHASE,
)  #: Phases of the log: the hand holds still, moves, is off


class TaughtMove(NamedTuple):
    """One move of the hand in one mode."""

    mode: str
    direction: str
    duration: float  #: [s]
    off: float  #: How long the arm is left to itself after it [s]

    @property
    def pace(self) -> str:
        """Fast, slow, or the duration; along a path it has none."""
        if math.isnan(self.duration):
            return "path"
        return {FAST_S: "fast", SLOW_S: "slow"}.get(self.duration, f"{self.duration:g}s".replace(".", "p"))


class MoveTable(NamedTuple):
    """A move, one row a step."""

    motion: HandMotion
    servos: Array  #: 1 while the servos hold, shape (n,)
    phase: NDArray[np.int8]  #: Shape (n,)


def moves_of(guide: GuideConfig, hand: HandConfig) -> list[TaughtMove]:
    """The moves a scenario asks for; only the last one is followed for long after the hand has released
    it."""
    if guide.mode:
        check_name("mode", guide.mode, MODES)
    if guide.direction:
        check_name("direction", guide.direction, DIRECTIONS)
    modes = [guide.mode] if guide.mode else list(MODES)
    directions = [guide.direction] if guide.direction else list(DIRECTIONS)
    if guide.duration_s and guide.duration_s < (
        shortest := max(least_duration(direction, guide, hand) for direction in directions)
    ):
        raise InputError(
            f"--duration {guide.duration_s:g}: the hand would come so near guide.tool_speed_limit_m_s or "
            f"guide.joint_speed_limit_rad_s that help fades. Set --duration {shortest:.3f} or longer."
        )
    durations = [guide.duration_s] if guide.duration_s else [FAST_S, SLOW_S]
    moves = [TaughtMove(m, d, s, 0.0) for m in modes for d in directions for s in durations]
    # An arm that does not carry itself is not released.
    return [*moves[:-1], moves[-1]._replace(off=hand.off_s if MODES[moves[-1].mode].gravity else 0.0)]


def servos_hold(t: Array) -> Array:
    """Share of the servos that hold the arm at times of a move (n,) [s]."""
    return np.clip((HOLD_S + RELEASE_S - t) / RELEASE_S, 0.0, 1.0)


def minimum_jerk(share: Array) -> tuple[Array, Array]:
    """Way and speed of a minimum-jerk move of unit length and duration at shares of its time, clipped to
    0..1."""
    u = np.clip(share, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * u**2 * (1.0 - u) ** 2


def move_table(move: TaughtMove, hand: HandConfig, T_base_home: Array, dt: float) -> MoveTable:
    """Where the hand wants the tool at every step of a move, centred on the pose ``T_base_home``."""
    begin = HOLD_S + RELEASE_S + hand.before_s
    duration = move.duration
    end = begin + duration + hand.after_s
    t: Array = np.arange(round((end + move.off) / dt)) * np.float64(dt)
    way, speed = minimum_jerk((t - begin) / duration)
    along = np.array(DIRECTIONS[move.direction])
    positions = T_base_home[:3, 3] + hand.distance_m * (way - 0.5)[:, None] * along
    velocities = hand.distance_m / duration * speed[:, None] * along
    rotations = np.tile(T_base_home[:3, :3], (len(t), 1, 1))
    grip = ((t >= HOLD_S) & (t < end)).astype(float)
    phase = np.where((t >= begin) & (t < begin + duration), MOVING, np.where(t < end, HELD, OFF)).astype(
        np.int8
    )
    return MoveTable(HandMotion(positions, velocities, rotations, grip), servos_hold(t), phase)


def least_duration(direction: str, guide: GuideConfig, hand: HandConfig) -> float:
    """Of the hand's move, so that neither the tool nor a joint gets to where the compensation fades [s]."""
    T_base_tool, dt = home_pose(), 0.01
    table = move_table(TaughtMove("", direction, 1.0, 0.0), hand, T_base_tool, dt)
    q = [np.array(HOME)]
    for T_base_tool[:3, 3] in table.motion.positions[table.phase == MOVING]:
        q.append(joints_for(T_base_tool, q[-1]))
    joints = np.abs(np.gradient(q[1:], dt, axis=0)).max() / guide.joint_speed_limit_rad_s
    tool = np.abs(table.motion.velocities).max() / guide.tool_speed_limit_m_s
    return float(max(joints, tool)) / FADE_FROM


# Guided moves one after the other as a log, a trace and figures like any other run's.


class PlayedMove(NamedTuple):
    """A move and its result."""

    move: TaughtMove
    table: MoveTable
    run: GuidingRun

    @property
    def phase(self) -> NDArray[np.int8]:
        """Of the rows of its run, shape (n,)."""
        return self.table.phase[: len(self.run.rows)]


def trace_of_move(play: PlayedMove) -> Trace:
    """The exact trace of one move, with no contact."""
    tool = _motion(play, 1)
    return tool.trace(play.run.rows["time"], play.phase, arc_length(tool.tips))


def _motion(play: PlayedMove, every: int) -> ToolMotion:
    rows = play.run.rows[::every]
    motion = play.table.motion
    wanted = (each[: len(play.run.rows) : every] for each in (motion.positions, motion.rotations))
    return ToolMotion(rows["tool"], rows["R_base_tool"], rows["speed"], *wanted)


def move_columns(play: PlayedMove, case: int, every: int, real: bool) -> dict[str, Array]:
    """Columns of the log."""
    part = play.run.rows[::every]
    read = {"encoder_q_rad": part["read"]} if real else {}
    return {
        "time_s": part["time"],
        "q_rad": part["q"],
        "qd_rad_s": part["qd"],
        "torque_nm": part["torque"],
        **_motion(play, every).columns(),
        "wrench_raw_sensor": part["raw"],
        "phase": play.phase[::every].astype(float),
        "hand_force_n": part["force"],
        **read,
        "lent_j": part["lent"],
        "case": np.full(len(part), float(case)),
    }


def figures_of_moves(scenario: Checked, played: Sequence[PlayedMove], asked: int, wall: float) -> Figures:
    """Figures of every move under its name, of the last mode as a whole, of the modes beside each other, of
    the run."""
    measured = {
        _name(play.move): measure_move(_rows_in(play, MOVING)["force"], _is_whole(play), play.run.lent_j)
        for play in played
    }
    figures: Figures = {
        f"{move}_{name}": value for move, values in measured.items() for name, value in values.items()
    }
    last = played[-1].move.mode
    of_last = [measured[_name(play.move)] for play in played if play.move.mode == last]
    # An undefined figure of one move makes that of the mode undefined.
    figures |= {name: np.max([values[name] for values in of_last]) for name in of_last[0]}
    let_go = _rows_in(played[-1], OFF)
    figures |= measure_drift(let_go["time"], let_go["q"])
    figures |= compare_modes(measured)
    figures |= {"moves": list(measured), "model": scenario.guide.model_file or "exact"}
    steps = sum(len(play.run.rows) for play in played)
    stops = [
        f"{_name(play.move).replace('_', ' ')}: {play.run.stop_reason}"
        for play in played
        if play.run.stop_reason
    ]
    whole = [play.run.stop_reason is None and len(play.run.rows) == len(play.table.servos) for play in played]
    figures |= free_figures(scenario.seed, None, steps, steps * scenario.simulation.timestep_s, wall)
    return figures | {
        "path_done": sum(whole) / asked,
        "protective_stop": "; ".join(stops) or None,
        "interrupted": any(play.run.interrupted for play in played),
    }


def _rows_in(play: PlayedMove, phase: int) -> NDArray[Any]:
    return play.run.rows[play.phase == phase]


def _is_whole(play: PlayedMove) -> bool:
    """Whether neither a stop, before it or in it, nor an interrupt cut the hand's move short."""
    guided = play.run.stop_step if play.run.stop_reason else len(play.run.rows)
    moving = np.flatnonzero(play.table.phase == MOVING)
    return len(moving) > 0 and guided > moving[-1]


def _name(move: TaughtMove) -> str:
    return f"{move.mode}_{move.direction}_{move.pace}"


def run_teach(scenario: Checked, observer: Observer) -> RunResult:
    """Let a hand move the arm in every mode, direction and pace asked for, and measure its force.

    Returns one log of all moves, their figures, and the modes beside each other; part, plan and controller
    play no role. Raises PolishSimError if a mode or direction is unknown, the model cannot be read, a move
    cannot be reached.
    """
    moves = moves_of(scenario.guide, scenario.hand)
    observer.stage("guide by hand")
    started = time.perf_counter()
    model = torque_arm(scenario)
    belief = believe_arm(scenario)
    T_base_home = home_pose()
    hand = hand_of(scenario.hand)
    # A mode that does not fit the arm is refused before the first move.
    arms = [guided_arm(scenario, move.mode, model, belief, hand) for move in moves]
    played: list[PlayedMove] = []
    for count, move in enumerate(moves):
        table = move_table(move, scenario.hand, T_base_home, scenario.simulation.timestep_s)
        T_base_tool = T_base_home.copy()
        T_base_tool[:3, 3] = table.motion.positions[0]
        run = run_guided(
            arms[count], joints_for(T_base_tool, np.array(HOME)), table.motion, table.servos,
            PartOf(observer, count, len(moves)),
        )  # fmt: skip
        played.append(PlayedMove(move, table, run))
        if run.interrupted:
            break
    figures = figures_of_moves(scenario, played, len(moves), time.perf_counter() - started)
    return RunResult(scenario, free_log(scenario, played, move_columns), trace_of_move(played[-1]), figures)


COAST_S = 1.0  #: A released arm may roll out for this long; what it moves then is drift [s]
#: Compared with the classical mode, and how their figures begin
RATIOS = {"inertia": "", "assist": "assist_"}


def measure_move(force: Array, whole: bool, lent_j: float) -> Figures:
    """The hand's force (n, 3) [N] while it moves, undefined if the move was cut short; the energy lent.

    hand_force_peak_n, hand_force_rms_n: of its norm; lent_energy_j: most the compensation had lent beyond
    what friction took.
    """
    sizes = norms(force)
    known = whole and len(sizes) > 0
    return {
        "hand_force_peak_n": sizes.max() if known else math.nan,
        "hand_force_rms_n": rms(sizes) if known else math.nan,
        "lent_energy_j": lent_j,
    }


def measure_drift(time: Array, q: Array) -> Figures:
    """What the joints (n, 6) do after the hand has released it, at times (n,) [s].

    coast_rad: largest way of a joint in the first second; drift_rad: from then on, to the end; drift_time_s:
    how long that is. Undefined if it was not released or for no longer than that.
    """
    if not len(time) or time[-1] - time[0] <= COAST_S:
        return {"coast_rad": math.nan, "drift_rad": math.nan, "drift_time_s": 0.0}
    rolled = np.searchsorted(time, time[0] + COAST_S)
    return {
        "coast_rad": np.abs(q[: rolled + 1] - q[0]).max(),
        "drift_rad": np.abs(q[rolled:] - q[rolled]).max(),
        "drift_time_s": time[-1] - time[rolled],
    }


def compare_modes(moves: Mapping[str, Figures]) -> Figures:
    """Modes beside each other, from figures by ``mode_direction_pace``; only if both moves exist, undefined
    if cut short.

    fast_peak_ratio_x, ... : force with inertia compensation by that of the classical law, fast move
    (``assist_`` before
    it: with the start-up assist); slow_peak_n: largest of the assist's slow moves.
    """
    figures: Figures = {}
    for mode, prefix in RATIOS.items():
        for direction in ("x", "y"):
            ours, theirs = (moves.get(f"{name}_{direction}_fast") for name in (mode, "classical"))
            if ours is None or theirs is None:
                continue
            for what in ("peak", "rms"):
                name = f"hand_force_{what}_n"
                figures[f"{prefix}fast_{what}_ratio_{direction}"] = ours[name] / theirs[name]
    for figure, some in (("none", "none_*"), ("classical", "classical_*"), ("slow", "assist_[xy]_slow")):
        forces = [moves[name]["hand_force_peak_n"] for name in fnmatch.filter(moves, some)]
        if forces:
            figures[f"{figure}_peak_n"] = np.max(forces)
    return figures
