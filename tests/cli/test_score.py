"""`polish-sim score` as a user calls it, on a small part of the battery."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.cli.conftest import PROGRAM, Tool

HERE = ["--on", "here"]
ONE = ["--case", "approach-20", "--seeds", "1", *HERE]
SHORT = ["--set", "process.hold_s=1.5"]
FILES = {"asked.json", "score.json", "score.md", "score.png", "metrics.json", "rows.jsonl", "report.html"}


def read(file: Path) -> dict[str, object]:
    loaded = json.loads(file.read_text())
    assert isinstance(loaded, dict)
    return loaded


@pytest.mark.pictures
def test_two_controllers_side_by_side_leave_table_markdown_json_and_figure(
    polish_sim: Tool, tmp_path: Path
) -> None:
    code, out, err = polish_sim("score", *ONE, "--against", "position", "--check", "--out", "s")
    assert code == 1, err  # hybrid-pi settles later than asked
    assert {file.name for file in (tmp_path / "s").iterdir()} == FILES
    assert out.splitlines()[-1] == "folder: s"
    assert "worst case of hybrid-pi" in out
    assert "never" in out  # position does not come within 1 N
    score = read(tmp_path / "s/score.json")
    assert score["controllers"] == ["hybrid-pi", "position"]
    assert score["seeds"] == 1
    assert set(score) >= {"cases", "worst_case", "rows", "versions", "definitions"}
    rows = score["rows"]
    assert isinstance(rows, list)
    assert [row["case"] for row in rows] == ["approach-20", "approach-20"]
    assert {"controllers", "cases", "seeds", "worst_case"} <= set(read(tmp_path / "s/metrics.json"))
    assert "freeform-60" in polish_sim("score", "--list").out
    page = (tmp_path / "s/score.md").read_text()
    assert "### approach-20" in page
    assert "worst, change" in page
    assert (tmp_path / "s/score.png").stat().st_size > 10_000

    lines = (tmp_path / "s/rows.jsonl").read_text()
    code, again, err = polish_sim("score", *ONE, "--against", "position", "--out", "s")
    assert code == 0
    assert "2 of 2 runs" in err
    assert again == out
    assert (tmp_path / "s/rows.jsonl").read_text() == lines


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_score_goes_on_after_ctrl_c_or_a_kill_and_gives_the_rows_of_one_that_was_not_ended(
    polish_sim: Tool, tmp_path: Path
) -> None:
    words, file = ["score", "--case", "noise-1", "--seeds", "8", *SHORT], tmp_path / "cut/rows.jsonl"
    for least, ended_by in ((1, signal.SIGKILL), (2, signal.SIGINT)):
        run = subprocess.Popen(
            [*PROGRAM, *words, "--workers", "1", "--out", "cut"], cwd=tmp_path, text=True,
            stderr=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        while not file.exists() or file.read_bytes().count(b"\n") < least:
            assert run.poll() is None, run.communicate()[1]
            time.sleep(0.02)
        run.send_signal(ended_by)
        out, err = run.communicate()
    assert run.returncode == 130, err
    assert "Traceback" not in err
    assert "--out cut" in err
    assert "worst case of hybrid-pi with --set" in out
    figures = read(tmp_path / "cut/metrics.json")
    assert isinstance(figures["runs"], int)
    assert 2 <= figures["runs"] < 8
    assert figures["runs_missing"] == 8 - figures["runs"]
    code, _, err = polish_sim(*words, *HERE, "--out", "cut")
    assert code == 0, err
    assert polish_sim(*words, *HERE, "--out", "whole")[0] == 0
    assert read(tmp_path / "cut/score.json")["rows"] == read(tmp_path / "whole/score.json")["rows"]


def test_a_user_s_file_is_scored_and_another_score_never_replaced_unasked(
    polish_sim: Tool, tmp_path: Path
) -> None:
    source = "class Down:\n    def reset(self, cycle_s): pass\n    def step(self, m, t): return t.twist\n"
    (tmp_path / "mine.py").write_text(source)
    words = ["score", "--controller", "mine.py:Down", *HERE, "--out", "s"]
    first = [*words, "--case", "step-10", "--seeds", "1"]
    assert polish_sim(*first)[0] == 0
    score = read(tmp_path / "s/score.json")
    assert score["controllers"] == ["mine.py:Down"]
    assert isinstance(score["rows"], list)
    assert score["rows"][0]["duration"] > 3.0
    whole = {file.name: file.read_bytes() for file in (tmp_path / "s").iterdir()}

    def refused(*asked: str) -> str:
        code, out, err = polish_sim(*asked)
        assert (code, out) == (2, "")
        assert {file.name: file.read_bytes() for file in (tmp_path / "s").iterdir()} == whole
        return err

    assert "seeds are 1, not 2" in refused(*words, "--case", "step-10", "--seeds", "2")
    assert "cases are step-10, not approach-20" in refused(*words, "--case", "approach-20", "--seeds", "1")
    assert "controllers are mine.py:Down, not position" in refused(*first, "--controller", "position")
    assert "a border, not" not in refused(*first, "--border")
    (tmp_path / "mine.py").write_text(source.replace("t.twist", "0.5 * t.twist"))
    assert "have changed" in refused(*first)
    assert polish_sim(*first, "--overwrite")[0] == 0
    assert (tmp_path / "s/score.json").read_bytes() != whole["score.json"]
