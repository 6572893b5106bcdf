"""Ctrl-C of the commands that record nothing on the way: 130, one line, and no file is left half written."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.cli.test_run import PROGRAM


def write_long_path(file: Path) -> None:
    """A spiral of 60,000 way points, which take seconds to read and to smooth."""
    rows = (
        (10.0 + 5e-4 * k, 0.02 * k / (10.0 + 5e-4 * k)) for k in range(60_000)
    )  # radius [mm] and angle of points 0.02 mm apart
    lines = (f"{r * math.cos(a):.5f},{r * math.sin(a):.5f},0,0,0,1" for r, a in rows)
    file.write_text("x,y,z,i,j,k\n" + "\n".join(lines) + "\n")


@pytest.mark.parametrize(
    "words",
    [
        ["smooth", "path.csv"],
        ["run", "smooth"],
        ["identify", "--starts", "50"],
        ["calibrate", "tcp", "--seeds", "100000"],
        ["calibrate", "base", "--seeds", "100000"],
    ],
    ids=" ".join,
)
def test_ctrl_c_is_130_with_one_line_and_nothing_half_written(words: list[str], tmp_path: Path) -> None:
    write_long_path(tmp_path / "path.csv")
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        [*PROGRAM, *words, "--out", "out/cut"], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    ) as run:
        while not (tmp_path / "out/.cut.part").exists():
            assert run.poll() is None, run.communicate()[1]
            time.sleep(0.02)
        time.sleep(1.0)
        run.send_signal(signal.SIGINT)
        _, err = run.communicate()
    assert run.returncode == 130, err
    assert "Traceback" not in err
    assert err.splitlines()[-1].startswith("error: interrupted")
    assert [path.name for path in tmp_path.iterdir()] == ["path.csv"]
