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


def _names(node: ast.AST) -> set[str]:
    names = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
    return names | {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}


def test_a_kernel_without_its_python_wrapper_is_called_by_kernels_only() -> None:
    """From Python it would crash the interpreter; names count whatever module they stand in."""
    bare, by_python = set[str](), dict[str, Path]()
    for folder in ("src", "cli", "models", "tests", "benchmarks", "examples"):
        for file in (ROOT / folder).rglob("*.py"):
            tree = ast.parse(file.read_text(encoding="utf-8"))
            kernels = [f for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) and _options(f) is not None]
            bare |= {kernel.name for kernel in kernels if BARE in (_options(kernel) or set())}
            for kernel in kernels:
                kernel.name, kernel.body = "", [ast.Pass()]
            by_python |= dict.fromkeys(_names(tree), file)
    assert len(bare) > 20
    assert {name: by_python[name] for name in bare & by_python.keys()} == {}
