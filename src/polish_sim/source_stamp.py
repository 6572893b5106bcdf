"""A hash of a module's source and of everything in this package it imports: what its compiled kernels depend
on."""

from __future__ import annotations

import ast
import hashlib
import os
from functools import cache
from importlib.util import find_spec
from pathlib import Path

_PACKAGE = __name__.partition(".")[0]
_CLI, _MODELS = f"{_PACKAGE}.cli", f"{_PACKAGE}.models"  # in a checkout they are elsewhere
# The first two only find what was compiled; kernels take an arm as an argument.
_NOT_COMPILED_IN = {f"{_PACKAGE}.{name}" for name in ("kernel_cache", "source_stamp", "arms")}

# they share runs out and show results: no figure depends on them
_ONLY_SHOWN = ("page/", "workers")
_SOURCES = (".py", ".toml", ".xml", ".npz", ".stl")


def short_hash(content: bytes) -> str:
    """What identifies a content, 24 hex digits."""
    return hashlib.sha256(content).hexdigest()[:24]


@cache
def package_hash() -> str:
    """Hash of everything in this package that a result may depend on: its source, its commands, its tables
    and its models."""
    files = {
        f"{prefix}{path.relative_to(folder).as_posix()}": path
        for prefix, package in (("", _PACKAGE), ("cli/", _CLI), ("models/", _MODELS))
        if (folder := _folder(package))
        for path in Path(folder).rglob("*")
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
    """Hash (16 hex digits) of the files a module's kernels are compiled from, and of the compiler's
    versions."""
    digest = hashlib.sha256(compiler.encode())
    for name in sorted(_dependencies(module)):
        digest.update(name.encode())
        digest.update(_digest(name))
    return digest.hexdigest()[:16]


def _dependencies(module: str) -> set[str]:
    """A module and all of this package it imports at its top, directly or not; imports inside functions come
    later."""
    found = {module}
    waiting = [module]
    while waiting:
        for name in imports_of(waiting.pop()) - found - _NOT_COMPILED_IN:
            found.add(name)
            waiting.append(name)
    return found


@cache
def imports_of(module: str) -> frozenset[str]:
    """Modules of this package that a module imports at its top."""
    names = set[str]()
    statements = _head(_source(module)).body
    if b"names_on_use(" in _source(module):  # its names are imported under TYPE_CHECKING
        statements = [
            inner for node in statements for inner in (node.body if isinstance(node, ast.If) else [node])
        ]
    for node in statements:
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.update((node.module, *(f"{node.module}.{alias.name}" for alias in node.names)))
    return frozenset(name for name in names if source_file(name))


def _head(source: bytes) -> ast.Module:
    """The statements before the first function or class, where all imports stand; parsing whole files takes
    0.2 s."""
    ends = [at for word in (b"\n@", b"\ndef ", b"\nclass ") if (at := source.find(word)) >= 0]
    try:
        return ast.parse(source[: min(ends, default=None)])
    except SyntaxError:  # a line of a docstring began with such a word
        return ast.parse(source)


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
    if package in (_CLI, _MODELS):
        spec = find_spec(package)
        return str(Path(spec.origin).parent) if spec and spec.origin else None
    return None


@cache
def _entries(folder: str) -> frozenset[str]:
    return frozenset(os.listdir(folder)) if os.path.isdir(folder) else frozenset()
