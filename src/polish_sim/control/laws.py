"""The controllers by name: the shipped laws, and a user's own from a Python file, ``FILE.py:CLASS``."""

from __future__ import annotations

import importlib.util
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType, ModuleType

from polish_sim.config import ControllerConfig
from polish_sim.control.hybrid import hybrid_pi, hybrid_pi_position, position
from polish_sim.control.signals import CompiledController, Controller
from polish_sim.errors import InputError, unknown_name
from polish_sim.lazy import FunctionOnUse

CONTROLLERS: Mapping[str, Callable[[ControllerConfig], CompiledController]] = MappingProxyType(
    {
        "hybrid-pi": hybrid_pi,
        "hybrid-adaptive": FunctionOnUse("polish_sim.control.adaptive.law", "hybrid_adaptive"),
        "hybrid-pi-position": hybrid_pi_position,
        "position": position,
        "admittance": FunctionOnUse("polish_sim.control.baselines", "admittance"),
        "impedance-position": FunctionOnUse("polish_sim.control.baselines", "impedance_position"),
        "force-mode": FunctionOnUse("polish_sim.control.baselines", "force_mode"),
    }
)

# What went wrong in a user's own code, with the line of it.


def tell_error(error: BaseException, file: str | Path | None) -> str:
    """An exception in one line: its kind, its message, and its place in the user's file if one of its lines took part.

    E.g. ``ValueError: negative gain (mine.py, line 12)``.
    """
    text = f"{type(error).__name__}: {' '.join(str(error).split())}"
    if file is None:
        return text
    own = Path(file).resolve()
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename).resolve() == own]
    return f"{text} ({Path(file).name}, line {frames[-1].lineno})" if frames else text


def file_of(thing: object) -> str | None:
    """The file a thing's class was written in, if it came from one."""
    return getattr(sys.modules.get(type(thing).__module__), "__file__", None)


def build_controller(config: ControllerConfig) -> Controller:
    """Make the controller a scenario names, a shipped one or ``FILE.py:CLASS``; it is not yet reset.

    Raises:
        InputError: If the name is unknown, or the file has no such class, or the class lacks a method.
    """
    if config.name in CONTROLLERS:
        return CONTROLLERS[config.name](config)
    file, separator, class_name = config.name.rpartition(":")
    if config.name.endswith(".py"):
        raise InputError(f"'{config.name}' does not say which class to use. Give it as {config.name}:CLASS.")
    if not separator:
        raise unknown_name("controller", config.name, [*CONTROLLERS, "FILE.py:CLASS"])
    return _load_class(Path(file), class_name)


def _load_class(path: Path, class_name: str) -> Controller:
    if not path.is_file():
        raise InputError(f"controller file '{path}' does not exist. Give it as FILE.py:CLASS.")
    module = _run_file(path, class_name)
    if not callable(getattr(module, class_name, None)):
        names = ", ".join(n for n, v in vars(module).items() if isinstance(v, type) and v.__module__ == module.__name__)
        raise InputError(f"no class '{class_name}' in '{path}'. Classes there: {names or 'none'}.")
    try:
        made = getattr(module, class_name)()
    except Exception as error:
        raise InputError(f"'{path}:{class_name}' cannot be made: {tell_error(error, path)}.") from error
    for method in ("reset", "step"):
        if not callable(getattr(made, method, None)):
            raise InputError(f"class '{class_name}' in '{path}' lacks the method {method}(); see docs/controllers.md.")
    return made  # type: ignore[no-any-return]


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
