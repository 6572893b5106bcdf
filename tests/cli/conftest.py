"""The command line as a user calls it, in an empty folder."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from polish_sim.cli.boundary import execute
from polish_sim.cli.main import commands

Tool = Callable[..., Any]  # called with the words of a command line
PROGRAM = [sys.executable, "-c", "from polish_sim.cli.main import app; app()"]


def metrics_of(folder: Path) -> dict[str, Any]:
    """The figures a command wrote into a folder."""
    return dict(json.loads((folder / "metrics.json").read_text(encoding="utf-8")))


class Call(NamedTuple):
    """What a command line left behind."""

    code: int
    out: str
    err: str


@pytest.fixture
def polish_sim(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., Call]:
    """Run `polish-sim` with the given words; the current folder is empty before the first call."""
    monkeypatch.chdir(tmp_path)

    def call(*words: object) -> Call:
        capfd.readouterr()
        code = execute(commands, [str(word) for word in words])
        return Call(code, *capfd.readouterr())

    return call
