"""What a long command says where no bar can be shown."""

import subprocess
import sys

from numba import njit

from polish_sim.cli import progress
from polish_sim.cli.progress import FIRST_START, compiling_shown, now_and_then


def test_a_long_stage_says_how_far_it_is_now_and_then(monkeypatch):
    said: list[str] = []
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(progress.sys.stderr, "isatty", lambda: False, raising=False)
    with progress.ProgressObserver.shown(said.append, ()) as observer:
        observer.stage("plan the path")
        for second in range(50):
            now[0] = 100.0 + second
            observer.progress(second, 50.0)
    shares = "", ": 40%, about 30 s left", ": 80%, about 10 s left"
    assert said == [f"plan the path{share}" for share in shares]


def test_compiling_is_told_once_and_only_when_it_happens():
    @njit
    def double(x):  # type: ignore[no-untyped-def]
        return 2 * x

    said: list[str] = []
    with compiling_shown(now_and_then(said.append)):
        assert double(3) == 6
        assert double(3.0) == 6.0
    assert said == [FIRST_START]
    with compiling_shown(now_and_then(said.append)):
        assert double(4) == 8
    assert said == [FIRST_START]
    progress.CompileProgress(said.append)._listen(["1/57\n", "a line of something else\n", "2/57\n"])  # ahead
    assert said[1:] == ["1/57", "2/57"]


def test_the_process_that_compiles_ahead_ends_when_its_kernels_are_there_or_its_parent_is_gone():
    command = [sys.executable, "-m", "polish_sim.cli.progress", "hybrid-pi"]
    for gone in (False, True):
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
            if gone:
                process.stdin.close()
            assert process.wait() == gone
