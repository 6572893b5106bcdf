"""Where compiled kernels are kept between runs: one folder per user, one subfolder per state of a module's sources.

Numba notices a change of the file a kernel stands in, not of the files it calls into: after an edit or an update old
machine code could go on running beside new. Here the subfolder's name holds a hash of the kernel's file and of every
file of this package it imports, directly or not, and of the compiler's versions. An edit therefore recompiles only
what depends on it, and several checkouts or versions share the folder without overwriting each other's kernels.

Kernels of other packages, a user's own controller for example, stay where numba keeps them.
"""

from __future__ import annotations

import atexit
import hashlib
import logging
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Final

_PACKAGE: Final = __name__.partition(".")[0]
_COMPILER: Final = "numba.core.caching"
_ELSEWHERE: Final = (f"{_PACKAGE}.cli", f"{_PACKAGE}.models")  # in a checkout
_SHARED: Final = "POLISH_SIM_KERNELS"  # a temporary folder that worker processes use too
_MOST_DAYS: Final = 60  # since a subfolder was last used
_MOST_BYTES: Final = 1 << 30
_DAY: Final = 86400.0
_IMPORT = re.compile(rf"^(?:from ({_PACKAGE}[\w.]*) import (\([^)]*\)|.*)|import ({_PACKAGE}[\w.]*))", re.MULTILINE)

_log = logging.getLogger(__name__)


def use_kernel_cache() -> None:
    """Keep this package's kernels in the user's folder, whether numba has been imported already or will be later."""
    if _COMPILER in sys.modules:
        _register(sys.modules[_COMPILER])
    elif not any(isinstance(finder, _CompilerFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _CompilerFinder())


def is_warm() -> bool:
    """Whether the simulation's kernels, as the sources are now, have been compiled before."""
    import numba  # noqa: F401  (its version is part of the folder's name)

    folder = _kernel_folder(f"{_PACKAGE}.cell.loop")
    return any(folder.glob("loop.advance*.nbc"))


class KernelLocator:
    """Says to numba where a kernel of this package is kept; knows nothing of other packages' kernels."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        self._py_file = py_file
        self._line = py_func.__code__.co_firstlineno
        self._folder = _kernel_folder(py_func.__module__)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> KernelLocator | None:
        """The locator of a function, None for one that is not in a source file of this package."""
        module = py_func.__module__ or ""
        return cls(py_func, py_file) if module.startswith(f"{_PACKAGE}.") and _source_file(module) else None

    def get_cache_path(self) -> str:
        """Folder of the kernel."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Nothing more to compare: the folder's name holds the hash of the sources."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """What tells two functions of the same name in one module apart."""
        return str(self._line)

    def ensure_cache_path(self) -> None:
        """Make the folder; numba calls this before it writes."""
        if not self._folder.exists():
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            _prune(self._folder.parent)


class _CompilerFinder:
    """Registers the locator as soon as numba's caching module is imported, without importing numba itself."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if name != _COMPILER:
            return None
        sys.meta_path.remove(self)  # type: ignore[arg-type]
        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            spec.loader.exec_module = _and_register(spec.loader.exec_module)  # type: ignore[method-assign, assignment]
        return spec


def _and_register(execute: Callable[[ModuleType], None]) -> Callable[[ModuleType], None]:
    def execute_and_register(module: ModuleType) -> None:
        execute(module)
        _register(module)

    return execute_and_register


def _register(caching: ModuleType) -> None:
    implementation = getattr(caching, "CacheImpl", None) or caching._CacheImpl  # the second until numba 0.61
    if KernelLocator not in implementation._locator_classes:
        implementation._locator_classes.insert(0, KernelLocator)


@cache
def _kernel_folder(module: str) -> Path:
    """Folder of a module's kernels as the sources are now; marked as used."""
    digest = hashlib.sha256(_compiler_version().encode())
    for name in sorted(_dependencies(module)):
        digest.update(name.encode())
        digest.update(_digest(name))
    folder = _home() / f"{module.removeprefix(f'{_PACKAGE}.')}-{digest.hexdigest()[:16]}"
    with suppress(OSError):  # it does not exist yet, or is read-only
        if time.time() - folder.stat().st_mtime > _DAY:
            os.utime(folder)
    return folder


def _compiler_version() -> str:
    numba, llvmlite = sys.modules["numba"], sys.modules["llvmlite"]
    return f"numba {numba.__version__}, llvmlite {llvmlite.__version__}, {sys.implementation.cache_tag}"


def _dependencies(module: str) -> set[str]:
    """A module and all of this package it imports at its top, directly or not; imports inside functions come later."""
    found, waiting = {module}, [module]
    while waiting:
        for name in _imports(waiting.pop()) - found:
            found.add(name)
            waiting.append(name)
    return found


@cache
def _imports(module: str) -> frozenset[str]:
    """Modules of this package that a module imports at its top."""
    names = set()
    for package, members, plain in _IMPORT.findall(_source(module).decode()):
        names.add(package or plain)
        names.update(f"{package}.{member}" for member in re.findall(r"\w+", members))
    return frozenset(name for name in names if _source_file(name))


@cache
def _digest(module: str) -> bytes:
    return hashlib.sha256(_source(module)).digest()


@cache
def _source(module: str) -> bytes:
    with open(_source_file(module) or "", "rb") as file:
        return file.read()


@cache
def _source_file(module: str) -> str | None:
    """File of one of this package's modules, None if there is no such module."""
    inside = _folder(module)
    if inside:
        return f"{inside}/__init__.py"
    package, _, name = module.rpartition(".")
    folder = _folder(package) if package else None
    return f"{folder}/{name}.py" if folder and f"{name}.py" in _entries(folder) else None


@cache
def _folder(package: str) -> str | None:
    """Folder of one of this package's packages, None if there is no such package."""
    if package == _PACKAGE:
        return str(Path(__file__).parent)
    parent, _, name = package.rpartition(".")
    above = _folder(parent) if parent else None
    if above is None:
        return None
    if name in _entries(above):
        return f"{above}/{name}" if "__init__.py" in _entries(f"{above}/{name}") else None
    if package in _ELSEWHERE:
        spec = find_spec(package)
        return str(Path(spec.origin).parent) if spec and spec.origin else None
    return None


@cache
def _entries(folder: str) -> frozenset[str]:
    return frozenset(os.listdir(folder)) if os.path.isdir(folder) else frozenset()


@cache
def _home() -> Path:
    """The folder of all kernels: the user's own and closed to others, for cached kernels are executable code."""
    shared = os.environ.get(_SHARED)
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(shared) if shared else Path(chosen) / _PACKAGE if chosen else _user_cache() / "polish-sim" / "kernels"
    trouble = _trouble(folder)
    if trouble is None:
        return folder
    temporary = Path(tempfile.mkdtemp(prefix="polish-sim-kernels-"))
    os.environ[_SHARED] = str(temporary)
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    _log.warning("warning: compiled kernels are not kept: %s. Every start compiles them again.", trouble)
    return temporary


def _trouble(folder: Path) -> str | None:
    """Why kernels cannot be kept in a folder; it is made if it does not exist."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.lstat()
    except OSError as error:
        return f"{folder} cannot be made ({error.strerror})"
    if hasattr(os, "getuid"):
        if stat.S_ISLNK(state.st_mode):
            state = folder.stat()
        if state.st_uid != os.getuid():
            return f"{folder} belongs to another user; delete it or set NUMBA_CACHE_DIR to a folder of your own"
        if state.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return f"others can write to {folder} (chmod go-w would close it)"
    return None if os.access(folder, os.W_OK) else f"{folder} is read-only"


def _user_cache() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


@cache
def _prune(home: Path) -> None:
    """Delete subfolders long unused, and beyond the size kept the ones unused longest; once per process."""
    now, total = time.time(), 0
    for used, folder in sorted(_folders(home), reverse=True):
        total += sum(file.stat().st_size for file in folder.glob("*.nb?"))
        if now - used > _MOST_DAYS * _DAY or total > _MOST_BYTES:
            shutil.rmtree(folder, ignore_errors=True)
    for old in home.parent.glob("kernels-*"):  # of versions that kept one folder per state of the whole package
        shutil.rmtree(old, ignore_errors=True)


def _folders(home: Path) -> Iterator[tuple[float, Path]]:
    for folder in home.iterdir():
        with suppress(FileNotFoundError):  # another process has just deleted it
            yield folder.stat().st_mtime, folder
