"""The house stands: imports go down the layers, every package is shipped, nothing heavy loads with the command line."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MODULES_AT_LEAST = 50


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package in one folder, as installed; returns the folder to import from."""
    folder = tmp_path_factory.mktemp("tree")
    runpy.run_path(str(ROOT / ".ci" / "assemble.py"))["assemble"](folder)
    return folder


def test_import_contracts_hold_for_every_module(tree: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(tree)}
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as main; main()", "--no-cache"]
    run = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    seen = re.search(r"Analyzed (\d+) files", run.stdout)
    assert seen, run.stdout
    existing = len(list(_python_files(tree)))
    assert int(seen[1]) == existing, f"import-linter saw {seen[1]} modules of {existing}"
    assert existing >= MODULES_AT_LEAST
    assert "2 kept, 0 broken" in run.stdout


def test_an_import_against_the_layers_is_noticed(tree: Path, tmp_path: Path) -> None:
    upward = tmp_path / "upward"
    runpy.run_path(str(ROOT / ".ci" / "assemble.py"))["assemble"](upward)
    (upward / "polish_sim" / "errors.py").unlink()
    source = (ROOT / "src" / "polish_sim" / "errors.py").read_text(encoding="utf-8")
    planted = source.replace("from collections.abc", "import polish_sim.cli.main\nfrom collections.abc", 1)
    (upward / "polish_sim" / "errors.py").write_text(planted, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(upward)}
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as main; main()", "--no-cache"]
    run = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert "polish_sim.errors -> polish_sim.cli.main" in run.stdout


def test_every_package_folder_is_listed_for_the_wheel() -> None:
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    mapping = setuptools["package-dir"]
    found = {
        ".".join((package, *init.parent.relative_to(ROOT / folder).parts))
        for package, folder in mapping.items()
        for init in (ROOT / folder).rglob("__init__.py")
    }
    assert found == set(setuptools["packages"])


def test_the_command_line_starts_without_the_heavy_libraries() -> None:
    heavy = "mujoco, numba, scipy, trimesh, matplotlib"
    program = f"import sys, polish_sim.cli.main; print(*(set('{heavy}'.split(', ')) & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == ""


def _python_files(tree: Path) -> list[Path]:
    return [
        Path(folder) / name
        for folder, _folders, names in os.walk(tree, followlinks=True)
        for name in names
        if name.endswith(".py")
    ]
