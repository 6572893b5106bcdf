"""Names whose modules are imported at first use, so that a command waits only for what it uses."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any


def names_on_use(package: str) -> Callable[[str], Any]:
    """The ``__getattr__`` of a package whose names its ``__init__.py`` imports under ``if TYPE_CHECKING:``.

    The imports are indented once. The type checker and the reader see ordinary imports; each module is
    imported when one of its names is used; ``dir`` and completion know them before.
    """
    own = vars(sys.modules[package])
    own["__dir__"] = lambda: sorted({*own, *_homes(package)})

    def load(name: str) -> Any:
        if name not in (homes := _homes(package)):
            offers = ", ".join(sorted(homes))
            raise AttributeError(f"module '{package}' has no attribute '{name}'; it offers {offers}")
        value = getattr(import_module(homes[name]), name)
        own[name] = value
        return value

    return load


@cache
def _homes(package: str) -> dict[str, str]:
    """Module by name."""
    tree = ast.parse(Path(sys.modules[package].__file__ or "").read_bytes())
    imports = [inner for node in tree.body if isinstance(node, ast.If) for inner in node.body]
    found = [node for node in imports if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name: node.module or "" for node in found for alias in node.names}


class FunctionOnUse:
    """A function of another module, imported when it is called or its docstring is read."""

    def __init__(self, module: str, name: str) -> None:
        self._module, self._name = module, name

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Import the function and call it."""
        return self._function(*arguments, **named)

    @property
    def __doc__(self) -> str | None:  # type: ignore[override]
        return self._function.__doc__

    @property
    def _function(self) -> Callable[..., Any]:
        return getattr(import_module(self._module), self._name)
