"""A hash of a module's source and of everything in this package it imports: what its compiled kernels depend on."""

from __future__ import annotations

import hashlib
import os
import re
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

_PACKAGE: Final = __name__.partition(".")[0]
_ELSEWHERE: Final = (f"{_PACKAGE}.cli", f"{_PACKAGE}.models")  # in a checkout
_NOT_COMPILED_IN: Final = {f"{_PACKAGE}.kernel_cache", f"{_PACKAGE}.source_stamp"}  # they only find what was compiled
_NAME: Final = rf"({_PACKAGE}[\w.]*)"
_IMPORT = re.compile(rf"^(    )?(?:from {_NAME} import (\([^)]*\)|.*)|import {_NAME})", re.MULTILINE)

_ONLY_SHOWN: Final = ("cli/", "page/", "workers")  # they start runs and show results: no figure depends on them
_SOURCES: Final = (".py", ".xml", ".npz", ".stl")


@cache
def package_hash() -> str:
    """Hash of everything in this package that a result may depend on: its source, its tables and its models."""
    root, models = Path(__file__).resolve().parent, _folder(f"{_PACKAGE}.models")
    folders = {"": root, "models/": Path(models)} if models else {"": root}
    files = {
        f"{prefix}{path.relative_to(folder).as_posix()}": path
        for prefix, folder in folders.items()
        for path in folder.rglob("*")
        if path.suffix in _SOURCES
    }
    digest = hashlib.sha256()
    for name, path in sorted(files.items()):
        if not name.startswith(_ONLY_SHOWN):
            digest.update(name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def source_stamp(module: str, compiler: str) -> str:
    """Hash (16 hex digits) of the files a module's kernels are compiled from, and of the compiler's versions."""
    digest = hashlib.sha256(compiler.encode())
    for name in sorted(_dependencies(module) - _NOT_COMPILED_IN):
        digest.update(name.encode())
        digest.update(_digest(name))
    return digest.hexdigest()[:16]


def _dependencies(module: str) -> set[str]:
    """A module and all of this package it imports at its top, directly or not; imports inside functions come later."""
    found, waiting = {module}, [module]
    while waiting:
        for name in imports_of(waiting.pop()) - found:
            found.add(name)
            waiting.append(name)
    return found


@cache
def imports_of(module: str) -> frozenset[str]:
    """Modules of this package that a module imports at its top."""
    names, lazy = set(), b"names_on_use(" in _source(module)  # its names are imported under TYPE_CHECKING
    for indented, package, members, plain in _IMPORT.findall(_source(module).decode()):
        if indented and not lazy:
            continue
        names.add(package or plain)
        names.update(f"{package}.{member}" for member in re.findall(r"\w+", members))
    return frozenset(name for name in names if source_file(name))


@cache
def _digest(module: str) -> bytes:
    return hashlib.sha256(_source(module)).digest()


@cache
def _source(module: str) -> bytes:
    with open(source_file(module) or "", "rb") as file:
        return file.read()


@cache
def source_file(module: str) -> str | None:
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
