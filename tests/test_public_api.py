"""What a Python user imports from the package is there, and costs nothing until it is used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import polish_sim


def test_every_public_name_resolves() -> None:
    for name in polish_sim.__all__:
        assert getattr(polish_sim, name) is not None


def test_unknown_name_says_what_there_is() -> None:
    with pytest.raises(AttributeError, match="run_surface"):
        _ = polish_sim.run_everything


def test_importing_the_package_loads_no_simulator() -> None:
    program = "import sys, polish_sim; print('mujoco' in sys.modules or 'numba' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"
