"""The environments: episodes drawn from ranges, and one step of Gymnasium."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.analysis.claim import shortfalls
from polish_sim.arrays import Array
from polish_sim.cell.cell import Cell
from polish_sim.cell.contact import RealPart
from polish_sim.cell.guards import NO_STOP
from polish_sim.cell.kernel import FORCE
from polish_sim.cell.limits import check_contact_settings
from polish_sim.cell.real_part import PartFields, displacement_of, place_part
from polish_sim.cell.recorder import TraceStep, build_recorder, trace_from
from polish_sim.cell.stroke import FEEDING, RETRACT, TARE_START, TARE_TIME, begin_next_stroke, cycle_time
from polish_sim.cell.wrist_sensor import DRAWS
from polish_sim.config import Checked, Scenario, SimulationConfig
from polish_sim.control.hybrid import hybrid_gains
from polish_sim.control.signals import CompiledController, Course, Measurement, Target
from polish_sim.envs.stepping import (
    ACTIONS,
    LARGEST,
    SEEN,
    SPARE,
    ActionContext,
    EnvState,
    Kept,
    Numbers,
    take_step,
)
from polish_sim.errors import ConfigError, InputError, check_name
from polish_sim.experiments.assembly import Workplace, build_cell, build_part, check, course_for, strokes_for
from polish_sim.experiments.registry import default_scenario
from polish_sim.experiments.surface import place_work
from polish_sim.scenario_file import load_scenario, override
from polish_sim.scoring.figures import REACH, STABLE, measure_score
from polish_sim.toml_text import read_toml

USUAL = ("simulation.control_every=2", "process.approach_speed_m_s=0.02", "safety.contact_lost_s=0.5")
"""What an environment sets of the experiment's default scenario: a host at 500 Hz that waits less for lost
contact."""
REWARDS = ("dense", "sparse")
ASKED = {
    "force": [row.claim for row in REACH if row.cases == "reach-springs-*"],
    "surface": [STABLE, *(row.claim for row in REACH if row.cases == "reach-freeform-30")],
}
"""Bands of the scorecard that are success: stable; ``force`` settled to ±1 N within 0.6 s, ``surface``
within 3 N."""
TRUTH = TraceStep.dtype.names
_LIVE = (
    *(
        "sensor.",
        "spindle.",
        "safety.",
        "robot.command",
        "robot.linear",
        "robot.angular",
        "pad.stiffness_n_m",
    ),
    *("pad.damping_s_m", "pad.friction", "part.displacement_m", "part.rotation_rad", "part.motion"),
)
# a new cell for every episode
_LATER = ("robot.", "head.", "process.", "payload.", "part.form_error_m")
_BLOCK = 1024  # steps whose noise is drawn at once

Ranges = Mapping[str, tuple[float, float]]
Info = dict[str, Any]


class Episode(NamedTuple):
    """What was drawn for an episode; ``cell.begin_again`` with the last three, the noise as seed, repeats
    it."""

    drawn: dict[str, float]  #: Values of the ranges
    scenario: Checked
    part: RealPart
    noise: int


def scenario_of(task: str, scenario: Scenario | str | Path | None, settings: Sequence[str]) -> Checked:
    """The scenario of an environment: the experiment's default with `USUAL`, a file or a scenario; and
    settings."""
    usual = override(default_scenario(task), USUAL)
    if scenario is not None and not isinstance(scenario, Scenario):
        scenario = load_scenario(Path(scenario), usual)
    chosen = override(scenario or usual, list(settings))
    if chosen.process.changes:
        raise ConfigError(
            "process.changes is for runs: an environment changes the set force with force_steps."
        )
    if chosen.experiment != task:
        raise ConfigError(f"the scenario is one of '{chosen.experiment}', the environment of '{task}'.")
    return check(chosen)


def ranges_of(ranges: Ranges | str | Path | None, scenario: Checked) -> Ranges:
    """Ranges as given, or read from a TOML file of ``"key" = [low, high]``, checked in a scenario."""
    if isinstance(ranges, (str, Path)):
        ranges = read_toml(Path(ranges), "ranges", ConfigError)
    known = dict(ranges or {})
    for key, bounds in known.items():
        if np.shape(bounds) != (2,) or not bounds[0] <= bounds[1]:
            raise ConfigError(f"the range of '{key}' is {bounds!r}: write (least, most).")
        if not key.startswith((*_LIVE, *_LATER)):
            raise ConfigError(
                f"'{key}' cannot change from episode to episode: make an environment for each value."
            )
        for value in bounds:
            check(override(scenario, [f"{key}={float(value)!r}"]))
    return {key: (float(low), float(high)) for key, (low, high) in known.items()}


class PolishEnv(gym.Env[Numbers, Numbers]):
    """Land the tool and hold or follow. Arguments, what is seen, done and rewarded: docs/learning.md."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012

    def __init__(
        self,
        task: str = "force",
        scenario: Scenario | str | Path | None = None,
        settings: Sequence[str] = (),
        ranges: Ranges | str | Path | None = None,
        action: str = "twist",
        rate_hz: int = 125,
        reward: str = "dense",
        force_steps: int = 0,
        force_range_n: tuple[float, float] = (15.0, 25.0),
        bodies: int = 1,
        time_limit_s: float | None = None,
        render_mode: str | None = None,
    ) -> None:
        words = (("action", action, ACTIONS), ("reward", reward, REWARDS), ("task", task, ASKED))
        for kind, name, known in words:
            check_name(kind, name, known)
        if force_steps and task == "surface":
            raise InputError(
                "force_steps is for PolishForce-v1: the path of PolishSurface-v1 names its forces."
            )
        if bodies < 1:
            raise InputError(f"bodies = {bodies}: there is at least one arm and part to choose from.")
        chosen = scenario_of(task, scenario, settings)
        self._dt = dt = chosen.simulation.timestep_s
        if force_steps:
            check_contact_settings(chosen, max(force_range_n))
        self._every = steps_per_action(chosen.simulation, rate_hz)
        self.task, self.action, self.rate_hz, self.sparse = task, action, rate_hz, reward == "sparse"
        self._force_steps, self._force_range = force_steps, force_range_n
        self._scenario = chosen
        self._bodies = bodies
        self._forms: dict[int, RealPart] = {}  #: By the seed that bends them
        self._ranges = ranges_of(ranges, chosen)
        self._rebuilds = any(not key.startswith(_LIVE) for key in self._ranges)
        self._place: Workplace = place_work(chosen)
        self.moving = not self._place.holds
        self._strokes = strokes_for(chosen, self._place)
        surface = self._place.region.surface
        self._middle: Array = surface.vertices[surface.faces].mean(axis=(0, 1))
        self._sizes = len(ACTIONS[action].scale) + self.moving
        limit = time_limit_s or 1.5 * cycle_time(self._strokes) + 1.0
        self._longest = round(limit / dt)
        self._recorder = build_recorder(self._longest + self._every + _BLOCK, 1 << 40)
        self._cells: dict[int, Cell] = {}
        self.action_space = gym.spaces.Box(-1.0, 1.0, (self._sizes,), np.float32)
        self.observation_space = gym.spaces.Box(-LARGEST, LARGEST, (SEEN + self._sizes,), np.float32)
        self.render_mode = render_mode
        self._renderer: Any = None

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Numbers, Info]:
        """Draw an episode and zero the sensor; the first action is asked for when the tool starts to come
        down.

        ``options={"start": "tare"}``: it is asked for before the sensor is zeroed.
        """
        super().reset(seed=seed)
        self._draw(np.random.default_rng(self.np_random.integers(2**63)))
        cell, kind = self.cell, ACTIONS[self.action]
        wait = 1 if (options or {}).get("start") == "tare" else round((TARE_START + TARE_TIME) / self._dt)
        turn = EnvState(
            every=self._every,
            due=wait - self._every,
            moving=self.moving,
            feed=cell.scenario.process.feed_m_s,
            last_stroke=len(cell.strokes) == 1,
            longest=self._longest,
            force_after=self._to_come[0][0] if self._to_come else math.inf,
            eventful=bool(cell.faults.waiting),
        )
        turn.scale[: len(kind.scale)] = list(kind.scale.values())
        context = ActionContext(gains=hybrid_gains(cell.scenario.controller), feed=1.0)
        cell.use_controller(CompiledController(context, kind.law))
        action = np.zeros(self._sizes, np.float32)
        if self.moving:
            action[-1] = 1.0
        self._kept = Kept(
            cell.kernel,
            cell.real_arm,
            self._recorder,
            cell.rng.standard_normal((_BLOCK, DRAWS)),
            turn,
            context,
            action,
            np.zeros(SEEN + self._sizes, np.float32),
            np.zeros(1, TraceStep.dtype),
        )
        self.measurement: Measurement = cell.state.measurement
        self.target: Target = cell.state.target
        *_, self._needs = take_step(self._kept)
        return self._kept.seen.copy(), {**self.truth(), "drawn": self.episode.drawn}

    def _draw(self, rng: np.random.Generator) -> None:
        drawn = {key: float(rng.uniform(*bounds)) for key, bounds in self._ranges.items()}
        body, noise = int(rng.integers(self._bodies)), int(rng.integers(2**63))
        scenario = Checked(override(self._scenario, [f"{key}={value!r}" for key, value in drawn.items()]))
        scenario = replace(scenario, seed=scenario.seed + body)
        part = self._found_part(scenario, rng)
        if self._rebuilds or body not in self._cells:
            strokes = () if self._rebuilds else self._strokes
            self._cells[body] = build_cell(scenario, self._place, part, strokes)
        self.cell = cell = self._cells[body]
        cell.begin_again(scenario, part, np.random.default_rng(noise))
        cell.kernel = cell.kernel._replace(stroke=cell.set_points.begin(cell.strokes[0]))
        self.episode = Episode(drawn, scenario, part, noise)
        forces = rng.uniform(*self._force_range, self._force_steps).tolist()
        hold = scenario.process.hold_s / (self._force_steps + 1)
        self._to_come = [(hold * (k + 1), force) for k, force in enumerate(forces)]
        self._set = [(0, scenario.process.contact_force_n)]

    def _found_part(self, scenario: Checked, rng: np.random.Generator) -> RealPart:
        """The part as bent by a scenario's seed, where an episode finds it."""
        if scenario.seed not in self._forms or "part.form_error_m" in self._ranges:
            straight = replace(scenario.part, displacement_m=0.0, rotation_rad=0.0)
            self._forms[scenario.seed] = build_part(replace(scenario, part=straight), self._place)
        form = self._forms[scenario.seed]
        normal = form.rotation.T @ np.array(form.normal)
        shift = displacement_of(scenario.part, normal, self._middle, rng)
        return place_part(PartFields(form.field, form.coarse), shift, self._place.reach.T_base_work, normal)

    def step(self, action: Numbers) -> tuple[Numbers, float, bool, bool, Info]:
        """Command an action until the next one is due."""
        self._kept.action[:] = action
        if self._needs:
            self.prepare()
        dense, asks, self._needs = take_step(self._kept)
        terminated = truncated = False
        info = self.truth()
        if not asks and not self.next_stroke():
            terminated, truncated, end = self.end()
            info |= end
        reward = float(info.get("success", False)) if self.sparse else dense
        return self._kept.seen.copy(), reward, terminated, truncated, info

    def prepare(self) -> None:
        """Draw the noise of the steps to come, let faults happen, change the set force when it is time."""
        turn, draws, steps = self._kept.turn, self._kept.draws, self.steps
        used = steps - turn.drawn_from
        if len(draws) - used < self._every + SPARE:
            kept = draws[used:].copy()
            draws[: len(kept)] = kept
            self.cell.rng.standard_normal(out=draws[len(kept) :])
            turn.drawn_from = steps
        if self.cell.faults.waiting:
            self.cell.faults.inject_due(self.cell)
            self.cell.state.status.pause_at_contact = False
        sequence = self.cell.state.sequence
        if self._to_come and sequence.stage == FEEDING and sequence.time >= self._to_come[0][0]:
            force = self._to_come.pop(0)[1]
            self.cell.set_points.change(FORCE, force, self.cell.kernel)
            self.cell.state.target.force = force
            self._set.append((steps, force))
            turn.force_after = self._to_come[0][0] if self._to_come else math.inf

    def next_stroke(self) -> bool:
        """Begin the next stroke if one is done and there is another."""
        cell, status = self.cell, self.cell.state.status
        left = [stroke for stroke in cell.strokes if stroke.start_s > cell.kernel.stroke.start_s]
        if not (status.arrived and left) or self.steps >= self._longest:
            return False
        status.arrived = False
        begin_next_stroke(cell.state.sequence)
        cell.kernel = cell.kernel._replace(stroke=cell.set_points.begin(left[0]))
        self._kept.turn.last_stroke = len(left) == 1
        self._kept = self._kept._replace(cell=cell.kernel)
        return True

    @property
    def steps(self) -> int:
        """Physics steps of the episode so far."""
        return int(self.cell.state.status.steps)

    def course(self, controller: Any) -> Course | None:
        """What lies ahead on the path, for a controller that prepares for it."""
        return course_for(controller, self.episode.scenario, self._place, self.cell.strokes)

    def truth(self) -> Info:
        """What the host does not know: the exact quantities of the last physics step, see `log.Trace`."""
        return {"privileged": dict(zip(TRUTH, self._kept.truth[0].copy().item(), strict=True))}

    def end(self) -> tuple[bool, bool, Info]:
        """Whether the episode has ended by itself, or by its time; its rows of the scorecard; if that is
        success."""
        cell, sequence = self.cell, self.cell.state.sequence
        stop = int(cell.state.status.stop)
        reason = None if stop == NO_STOP else cell.reasons[stop]
        done = sequence.stage >= RETRACT
        length = cell.kernel.stroke.process.length
        rows = self.figures(reason is None and done)
        success = not any(shortfalls(ASKED[self.task], figures) for figures in rows)
        terminated = reason is not None or bool(self.moving and done and sequence.s > length - 1e-6)
        return terminated, not terminated, {"stop_reason": reason or "", "figures": rows, "success": success}

    def figures(self, whole: bool) -> list[dict[str, Any]]:
        """Rows of the scorecard of the episode so far, one for every set force; ``whole``: it went to its
        end."""
        steps = self._recorder.trace[: self.steps]
        edges = [*(first for first, _ in self._set), len(steps)]
        rows = []
        for (a, b), (_, force) in zip(pairwise(edges), self._set, strict=True):
            trace = trace_from(steps[a:b])
            wanted = self._place.path.force_at(trace.path_s_m, force)
            rows.append(measure_score(trace, wanted, self.moving, whole))
        return rows

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the cell, (480, 640, 3), with ``render_mode="rgb_array"``."""
        if self.render_mode != "rgb_array":
            return None
        if self._renderer is None or self._renderer.model is not self.cell.model:
            self.close()
            self._renderer = mujoco.Renderer(self.cell.model, 480, 640)
        camera = mujoco.MjvCamera()
        camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (
            (0.0, -0.4, 0.15),
            1.3,
            125.0,
            -22.0,
        )
        self._renderer.update_scene(self.cell.data, camera)
        return self._renderer.render()

    def close(self) -> None:
        """Give the renderer back."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def steps_per_action(simulation: SimulationConfig, rate_hz: float) -> int:
    """Physics steps an action holds; a whole number of the host's cycles."""
    cycle = simulation.timestep_s * simulation.control_every
    cycles = round(1.0 / (rate_hz * cycle)) if rate_hz > 0.0 else 0
    if cycles < 1 or abs(cycles * cycle * rate_hz - 1.0) > 1e-6:
        raise ConfigError(
            f"rate_hz = {rate_hz:g} is not the host's {1.0 / cycle:g} Hz (1 / simulation.timestep_s / "
            "simulation.control_every) or that divided by a whole number."
        )
    return cycles * simulation.control_every
