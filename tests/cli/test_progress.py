"""What a long command says where no bar can be shown."""

from __future__ import annotations

import pytest
from numba import njit

from polish_sim.cli import progress
from polish_sim.cli.compiling import FIRST_START, compiling_told
from polish_sim.cli.progress import ProgressObserver


def test_a_long_stage_says_how_far_it_is_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(progress.sys.stderr, "isatty", lambda: False, raising=False)
    with ProgressObserver.shown(said.append, ()) as observer:
        observer.stage("plan the path")
        for second in range(50):
            now[0] = 100.0 + second
            observer.progress(second, 50.0)
    assert said == ["plan the path", "plan the path: 40%", "plan the path: 80%"]


def test_compiling_is_told_once_and_only_when_it_happens() -> None:
    @njit
    def double(x):  # type: ignore[no-untyped-def]
        return 2 * x

    said: list[str] = []
    with compiling_told(said.append):
        assert double(3) == 6
        assert double(3.0) == 6.0
    assert said == [FIRST_START]
    with compiling_told(said.append):
        assert double(4) == 8
    assert said == [FIRST_START]
