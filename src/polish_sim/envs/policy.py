"""Policies: shipped controllers as policies of an environment, policy files as controllers of a run or a
score."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from functools import cache
from multiprocessing import parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import ZipFile

import numpy as np

from polish_sim.config import ControllerConfig
from polish_sim.control.hybrid import hybrid_gains
from polish_sim.control.laws import build_controller, tell_error
from polish_sim.control.signals import CompiledController, Measurement, Target
from polish_sim.envs.stepping import ACTIONS, SEEN, ActionContext, Numbers, observe_law
from polish_sim.errors import InputError, PolishSimError, check_name, needed
from polish_sim.workers import local_copy

if TYPE_CHECKING:
    from polish_sim.arrays import Array
    from polish_sim.envs.env import PolishEnv

_log = logging.getLogger(__name__)
Policy = Callable[[Numbers], Numbers]
"""From an observation to an action, each number within -1 to 1."""


class ControllerPolicy:
    """A controller by name, or an own one, as policy of an environment with the action ``twist``.

    It gets what it gets in a run, measurement and target, and reads them from the environment. Call `reset`
    after that of the environment.
    """

    def __init__(self, env: Any, name: str = "hybrid-pi") -> None:
        self._env: PolishEnv = env.unwrapped
        if self._env.action != "twist":
            raise InputError("a controller answers twists: make the environment with action='twist'.")
        self._name = name
        self.controller: Any = None

    def reset(self) -> None:
        """Forget everything, and prepare for the path of the new episode if the controller does."""
        env = self._env
        config = ControllerConfig(**{**vars(env.episode.scenario.controller), "name": self._name})
        self.controller = build_controller(config)
        course = env.course(self.controller)
        if course is not None:
            self.controller.prepare(course)
        self.controller.reset(1.0 / env.rate_hz)

    def __call__(self, _seen: Numbers) -> Numbers:
        """The action that commands what the controller answers."""
        env = self._env
        R = env.measurement.rotation
        scale = list(ACTIONS["twist"].scale.values())
        answer = self.controller.step(env.measurement, env.target)
        twist = np.concatenate([R.T @ answer[:3], R.T @ answer[3:6]]) / scale
        feed = [2.0 * answer[6] - 1.0 if len(answer) > 6 else 1.0]
        return np.concatenate([twist, feed if env.moving else []]).astype(np.float32)


def evaluate(env: Any, policy: Policy, episodes: int, seed: int = 0) -> list[dict[str, Any]]:
    """Rows of the scorecard of some episodes, seeds from ``seed`` on, with ``success``, ``reward`` and
    ``stop``."""
    rows = []
    for number in range(episodes):
        seen, _ = env.reset(seed=seed + number)
        if callable(reset := getattr(policy, "reset", None)):
            reset()
        total, over, info = 0.0, False, {}
        while not over:
            seen, reward, terminated, truncated, info = env.step(policy(seen))
            total = total + reward
            over = terminated or truncated
        end = {"success": info["success"], "reward": total, "stop": info["stop_reason"]}
        rows += [{"seed": seed + number, **figures, **end} for figures in info["figures"]]
    return rows


# A policy file as controller: the environment's observation in, its action out, passed on by the
# environment's law.


class PolicyController:
    """A policy that drives the cell: asked at the rate it was made for, held in between.

    It is asked for the first time when the tool starts to move, as in the environment. ``sizes``: numbers of
    an action.
    """

    def __init__(
        self, policy: Policy, sizes: int, action: str, rate_hz: float, config: ControllerConfig
    ) -> None:
        check_name("action", action, ACTIONS)
        scale = np.array(list(ACTIONS[action].scale.values()))
        law = ACTIONS[action].law
        if not 0 <= sizes - len(scale) <= 1:
            raise InputError(
                f"the policy answers {sizes} numbers, the action '{action}' has {len(scale)} or one more."
            )
        self._context: Any = ActionContext(gains=hybrid_gains(config))
        self._looks, self._law = (CompiledController(self._context, one) for one in (observe_law, law))
        self._policy, self._sizes, self._scale, self._period = policy, sizes, scale, 1.0 / rate_hz

    def reset(self, cycle_s: float) -> None:
        """Forget everything."""
        self._law.reset(cycle_s)
        self._next = math.inf
        self._put(np.zeros(self._sizes, np.float32))

    def step(self, measurement: Measurement, target: Target) -> Array:
        """What the law makes of the last action; a new one is asked for when it is due."""
        time = measurement.time
        if math.isinf(self._next) and (target.contact or np.any(target.twist)):
            self._next = time
        if time > self._next - 1e-9:
            self._next += self._period
            self._looks.step(measurement, target)
            seen = np.concatenate([self._context.seen, self._action], dtype=np.float32)
            self._put(np.clip(self._policy(seen), -1.0, 1.0))
        return self._law.step(measurement, target)

    def _put(self, action: Numbers) -> None:
        count = len(self._scale)
        self._action, self._context.command[:count] = action, self._scale * action[:count]
        asked = self._sizes > count and math.isfinite(self._next)
        self._context.feed = 0.5 * (float(action[-1]) + 1.0) if asked else 1.0


def linear(weights: Array) -> Policy:
    """The policy clip(W (observation, 1)), W of shape (numbers of an action, those of an observation + 1)."""
    return lambda seen: np.clip(weights[:, :-1] @ seen + weights[:, -1], -1.0, 1.0).astype(np.float32)


def save_linear(file: Path, weights: Array, env: Any) -> None:
    """Write the policy of ``linear`` with the action and the rate of its environment."""
    own = env.unwrapped
    np.savez(file, weights=weights.astype(np.float32), action=own.action, rate_hz=own.rate_hz)


def load_policy(config: ControllerConfig) -> PolicyController:
    """The controller ``FILE.npz:linear`` or ``FILE.zip:sb3``, which has its action, rate and algorithm in
    ``own``.

    Raises:
        InputError: If the file cannot be used.
    """
    given, _, kind = config.name.rpartition(":")
    file = local_copy(given)
    if not Path(file).is_file():
        raise InputError(f"policy file '{file}' does not exist. Give it as FILE.npz:linear or FILE.zip:sb3.")
    try:
        policy, sizes, made_for = {"linear": _load_linear, "sb3": _load_sb3}[kind](file, dict(config.own))
        return PolicyController(policy, sizes, str(made_for["action"]), float(made_for["rate_hz"]), config)
    except PolishSimError:
        raise
    except Exception as error:
        raise InputError(f"'{file}' is no policy of the kind '{kind}': {tell_error(error, None)}.") from error


def _load_linear(file: str, own: dict[str, Any]) -> tuple[Policy, int, Mapping[str, Any]]:
    if own:
        raise InputError(
            f"controller.own.{next(iter(own))} is for an own controller: '{file}' holds its own settings."
        )
    with ZipFile(file), np.load(file) as held:
        weights = held["weights"]
        made_for = {"action": held["action"], "rate_hz": held["rate_hz"]}
    if weights.ndim != 2 or weights.shape[1] != SEEN + weights.shape[0] + 1:
        raise InputError(f"the weights in '{file}' have the shape {weights.shape}, not (n, {SEEN} + n + 1).")
    return linear(weights), len(weights), made_for


def _load_sb3(file: str, own: dict[str, Any]) -> tuple[Policy, int, Mapping[str, Any]]:
    made_for = {"action": "twist", "rate_hz": 125.0, "algorithm": "PPO"} | own
    algorithms = needed("stable_baselines3", "a policy of the kind 'sb3' needs stable-baselines3", "rl")
    _say_code_runs(file)
    model = getattr(algorithms, str(made_for["algorithm"])).load(file, device="cpu")
    return lambda seen: model.predict(seen, deterministic=True)[0], model.action_space.shape[0], made_for


@cache
def _say_code_runs(file: str) -> None:
    if parent_process() is None:  # workers load the same
        _log.warning(
            "note: '%s' is unpickled, which runs code it contains: load only policies you trust.", file
        )
