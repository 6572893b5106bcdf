"""Compiled kernels as the sources have them."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
BARE = "no_cpython_wrapper"


def _options(function: ast.FunctionDef) -> set[str] | None:
    """What a function's `njit` is told; None if it is not compiled."""
    for decorator in function.decorator_list:
        call = decorator.func if isinstance(decorator, ast.Call) else decorator
        if isinstance(call, ast.Name) and call.id in {"njit", "cfunc"}:
            return {word.arg or "" for word in decorator.keywords} if isinstance(decorator, ast.Call) else set()
    return None


def _kernels(tree: ast.Module) -> list[ast.FunctionDef]:
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and _options(node) is not None]


def _bare_names(tree: ast.Module, own: set[str], bare: dict[str, set[str]]) -> set[str]:
    """Names that mean kernels without wrappers in a file: its own ones and those it imports."""
    froms = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    imported = {(a.asname or a.name) for node in froms for a in node.names if a.name in bare.get(node.module or "", ())}
    return own | imported


def test_a_kernel_without_its_python_wrapper_is_called_by_kernels_only() -> None:
    """From Python it would crash the interpreter."""
    folders = ("src", "cli", "models", "tests", "benchmarks", "examples")
    trees = {
        ".".join(file.relative_to(ROOT).with_suffix("").parts).removeprefix("src."): ast.parse(file.read_text("utf-8"))
        for folder in folders
        for file in (ROOT / folder).rglob("*.py")
    }
    bare = {module: {k.name for k in _kernels(tree) if BARE in (_options(k) or ())} for module, tree in trees.items()}
    assert sum(map(len, bare.values())) > 5
    called = []
    for module, tree in trees.items():
        watched = _bare_names(tree, bare[module], bare)
        for kernel in _kernels(tree):
            kernel.body = [ast.Pass()]
        called += [(module, n.id) for n in ast.walk(tree) if isinstance(n, ast.Name) and n.id in watched]
    assert called == []
