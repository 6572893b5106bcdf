"""The controllers by name: the shipped laws, and a user's own from a Python file, ``FILE.py:CLASS``."""

from __future__ import annotations

import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import Field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from polish_sim.config import ControllerConfig
from polish_sim.config.key import key
from polish_sim.control.hybrid import force_mode, hybrid_pi, hybrid_pi_position, position
from polish_sim.control.signals import CompiledController, Controller
from polish_sim.errors import InputError, check_name, unknown_name
from polish_sim.lazy import FunctionOnUse
from polish_sim.scenario_file import checked_value
from polish_sim.workers import local_copy

CONTROLLERS: Mapping[str, Callable[[ControllerConfig], CompiledController]] = {
    "hybrid-pi": hybrid_pi,
    "hybrid-adaptive": FunctionOnUse("polish_sim.control.adaptive.law", "hybrid_adaptive"),
    "hybrid-pi-position": hybrid_pi_position,
    "position": position,
    "force-mode": force_mode,
}

POLICIES: Mapping[str, str] = {"linear": ".npz", "sb3": ".zip"}
"""Kinds of policy files, ``FILE:KIND``, with their suffix."""
_load_policy: Callable[[ControllerConfig], Controller] = FunctionOnUse(
    "polish_sim.envs.policy", "load_policy"
)

# What went wrong in a user's own code, with the line of it.


def tell_error(error: BaseException, file: str | Path | None) -> str:
    """An exception in one line: its kind, its message, and its place in the user's file if one of its lines
    took part.

    E.g. ``ValueError: negative gain (mine.py, line 12)``.
    """
    text = f"{type(error).__name__}: {' '.join(str(error).split())}"
    if file is None:
        return text
    own = Path(file).resolve()
    frames = [
        frame for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename).resolve() == own
    ]
    return f"{text} ({Path(file).name}, line {frames[-1].lineno})" if frames else text


def file_of(thing: object) -> str | None:
    """The file a thing's class was written in, if it came from one."""
    return getattr(sys.modules.get(type(thing).__module__), "__file__", None)


def build_controller(config: ControllerConfig) -> Controller:
    """Make the controller a scenario names, a shipped one, ``FILE.py:CLASS`` or a policy; it is not yet
    reset.

    Raises:
        InputError: If the name is unknown, or the file has no such class, or the class lacks a method or
            parameter.
        ConfigError: If a parameter of the class is of the wrong kind or out of its range.
    """
    if isinstance(config, GivenController):
        return config.made
    if config.name in CONTROLLERS:
        if config.own:
            raise InputError(
                f"controller.own.{next(iter(config.own))} is for an own controller, FILE.py:CLASS: "
                f"'{config.name}' has its gains under controller."
            )
        return CONTROLLERS[config.name](config)
    given, _, kind = config.name.rpartition(":")
    file = local_copy(given)
    if kind in POLICIES and file.endswith(POLICIES[kind]):
        return _load_policy(config)
    made_by = _load_class(config.name)
    _check_own(config, _parameters_of(made_by, config.name))
    try:
        made = made_by(**config.own)
    except Exception as error:
        raise InputError(f"'{config.name}' cannot be made: {tell_error(error, file)}.") from error
    return _with_methods(made, config.name)


# The parameters of a user's class: what its __init__ takes. `ranges` on the class says what each may be.


def law_parameters(name: str) -> dict[str, Field[Any]]:
    """The parameters of the class ``FILE.py:CLASS`` as fields, by name: the arguments of its ``__init__``.

    The default of one that has to be given is ``inspect.Parameter.empty``. A class attribute ``ranges``, e.g.
    ``{"gain": (0.001, 0.1)}``, bounds them.

    Raises:
        InputError: If there is no such class, or ``ranges`` names what ``__init__`` does not take.
    """
    return _parameters_of(_load_class(name), name)


def _parameters_of(made_by: Callable[..., Any], name: str) -> dict[str, Field[Any]]:
    try:
        taken = inspect.signature(made_by).parameters.values()
    except (TypeError, ValueError):  # a class written in C
        return {}
    named = {p.name: p.default for p in taken if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)}
    ranges = getattr(made_by, "ranges", {})
    if not isinstance(ranges, Mapping):
        raise InputError(f"the ranges of '{name}' are {ranges}: write {{NAME: (least, most)}}.")
    for own, bounds in ranges.items():
        check_name(f"parameter in the ranges of '{name}'", own, named)
        if not _is_range(bounds):
            raise InputError(f"the range of '{own}' in '{name}' is {bounds}: write (least, most).")
    said = f"the range '{name}' declares"
    return {own: key(default, said, *ranges.get(own, ())) for own, default in named.items()}


def _is_range(bounds: Any) -> bool:
    try:
        low, high = bounds
        return bool(float(low) == low < high == float(high))
    except (TypeError, ValueError):
        return False


def _check_own(config: ControllerConfig, known: Mapping[str, Field[Any]]) -> None:
    """Refuse parameters the class does not take, and values of another kind or out of range."""
    for own, value in config.own.items():
        check_name(f"parameter of '{config.label}', controller.own", own, known)
        default = known[own].default
        usual = default if isinstance(default, (bool, int, float, str)) else value
        checked_value(f"controller.own.{own}", value, usual, known[own])
    needed = [own for own, parameter in known.items() if parameter.default is inspect.Parameter.empty]
    missing = [own for own in needed if own not in config.own]
    if missing:
        raise InputError(
            f"'{config.label}' needs a value for '{missing[0]}': --set controller.own.{missing[0]}=..."
        )


class GivenController(ControllerConfig):
    """Settings that stand for a controller made before; its file, class and parameters are named as far as
    known."""

    made: Controller

    @classmethod
    def of(cls, controller: Controller, config: ControllerConfig) -> GivenController:
        """Settings like ``config`` for a controller object.

        Raises:
            InputError: If the object lacks a method.
        """
        kind, file, own = type(controller), file_of(controller), {}
        _with_methods(controller, kind.__name__)
        if not isinstance(controller, CompiledController):
            name = f"{file}:{kind.__name__}" if file else kind.__name__
            for key in inspect.signature(kind).parameters:
                value = getattr(controller, key, None)
                if isinstance(value, (bool, int, float, str)):
                    own[key] = value
            config = replace(config, name=name, own=own)
        given = cls(**vars(config))
        object.__setattr__(given, "made", controller)
        return given


def _with_methods(made: Any, name: str) -> Controller:
    for method in ("reset", "step"):
        if not callable(getattr(made, method, None)):
            raise InputError(f"the controller '{name}' lacks the method {method}(); see docs/controllers.md.")
    return made  # type: ignore[no-any-return]


def _load_class(name: str) -> Callable[..., Any]:
    file, separator, class_name = name.rpartition(":")
    if name.endswith(".py"):
        raise InputError(f"'{name}' does not say which class to use. Give it as {name}:CLASS.")
    if not separator:
        raise unknown_name("controller", name, [*CONTROLLERS, "FILE.py:CLASS"])
    path = Path(local_copy(file))
    if not path.is_file():
        raise InputError(f"controller file '{path}' does not exist. Give it as FILE.py:CLASS.")
    module = _run_file(path, class_name)
    made_by = getattr(module, class_name, None)
    if not callable(made_by):
        names = ", ".join(
            n for n, v in vars(module).items() if isinstance(v, type) and v.__module__ == module.__name__
        )
        raise InputError(f"no class '{class_name}' in '{path}'. Classes there: {names or 'none'}.")
    return made_by  # type: ignore[no-any-return]


def _run_file(path: Path, class_name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"_user_controller_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise InputError(f"controller file '{path}' is not a Python file (FILE.py:CLASS).")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up by its name
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"'{path}:{class_name}' cannot be loaded: {tell_error(error, path)}.") from error
    return module
