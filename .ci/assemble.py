"""Lay the package out in one folder, as a wheel does, so that the checkers see what a user imports.

The sources live in ``src/``, ``cli/`` and ``models/``; import-linter and mypy look for one folder per
package. The mapping is read from ``pyproject.toml`` and laid out as links: ``python .ci/assemble.py FOLDER``.
"""

from __future__ import annotations

import shutil
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def assemble(folder: Path) -> Path:
    """Fill ``folder`` with links to the sources, in the shape of the installed package; return the package's
    folder."""
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    shutil.rmtree(folder, ignore_errors=True)
    mapping: dict[str, str] = setuptools["package-dir"]
    for package in sorted(mapping, key=lambda name: name.count(".")):
        source, target = ROOT / mapping[package], folder.joinpath(*package.split("."))
        if any(name.startswith(f"{package}.") for name in mapping):
            target.mkdir(parents=True)
            for entry in source.iterdir():
                (target / entry.name).symlink_to(entry)
        else:
            target.symlink_to(source)
    return folder / "polish_sim"


if __name__ == "__main__":
    assemble(Path(sys.argv[1]))
