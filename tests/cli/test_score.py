"""`polish-sim score` as a user calls it, on a small part of the battery."""

from pathlib import Path

import pytest

from polish_sim.row_file import read_json
from polish_sim.scoring import score
from polish_sim.scoring.border import Rest
from tests.cli.conftest import assert_refused, done, metrics_of, refused

HERE = ["--on", "here"]
ONE = ["--case", "approach-20", "--seed", "500", "--seeds", "1", *HERE]
FILES = {"asked.json", "score.json", "score.md", "score.png", "metrics.json", "rows.jsonl", "report.html"}


@pytest.mark.pictures
def test_two_controllers_stand_side_by_side(polish_sim):
    code, out, err = polish_sim("score", *ONE, "--against", "position", "--check", "--out", "s")
    assert code == 1, err  # hybrid-pi settles later than asked
    assert {file.name for file in Path("s").iterdir()} == FILES
    assert out.splitlines()[-1] == "folder: s"
    assert "worst case of hybrid-pi" in out
    assert "never" in out  # position does not come within 1 N
    score = read_json(Path("s/score.json"))
    assert score["controllers"] == ["hybrid-pi", "position"]
    assert (score["first_seed"], score["seeds"]) == (500, 1)
    assert set(score) >= {"cases", "worst_case", "rows", "versions", "definitions"}
    assert [row["case"] for row in score["rows"]] == ["approach-20", "approach-20"]
    assert {"controllers", "cases", "seeds", "worst_case"} <= metrics_of("s").keys()
    assert "freeform-60" in polish_sim("score", "--list").out
    assert "| approach-20 | 20 N on a flat plate, approach 20 mm/s |" in Path("s/score.md").read_text()
    assert Path("s/score.png").stat().st_size > 10_000
    lines = Path("s/rows.jsonl").read_text()
    assert done(polish_sim("score", *ONE, "--against", "position", "--out", "s")).out == out
    assert Path("s/rows.jsonl").read_text() == lines


def test_an_interrupted_score_is_summed_up_and_resumes(polish_sim, tmp_path, monkeypatch):
    words = ["score", "--case", "noise-1", "--seeds", "2", "--set", "process.hold_s=1.5", "--on", "here"]
    measure = score._measure

    def interrupted(task):
        if task.seed == 1:
            raise KeyboardInterrupt
        return measure(task)

    with monkeypatch.context() as patch:
        patch.setattr(score, "_measure", interrupted)
        call = polish_sim(*words, "--out", "cut")
    refused(call, "--out cut", code=130)
    assert "worst case of hybrid-pi with --set" in call.out
    figures = metrics_of(tmp_path / "cut")
    assert (figures["runs"], figures["runs_missing"]) == (1, 1)
    done(polish_sim(*words, "--out", "cut"))
    assert [row["seed"] for row in read_json(Path("cut/score.json"))["rows"]] == [0, 1]


def test_a_score_of_a_user_s_file_is_not_replaced_unasked(polish_sim):
    source = "class Down:\n    def reset(self, cycle_s): pass\n    def step(self, m, t): return t.twist\n"
    Path("mine.py").write_text(source)
    words = ["score", "--controller", "mine.py:Down", *HERE, "--out", "s"]
    first = [*words, "--case", "step-10", "--seeds", "1"]
    done(polish_sim(*first))
    score = read_json(Path("s/score.json"))
    assert score["controllers"] == ["mine.py:Down"]
    assert score["rows"][0]["duration"] > 3.0
    whole = {file.name: file.read_bytes() for file in Path("s").iterdir()}
    for asked, said in (
        ([*words, "--case", "step-10", "--seeds", "2"], "seeds are 1, not 2"),
        ([*words, "--case", "approach-20", "--seeds", "1"], "cases are step-10, not approach-20"),
        ([*first, "--controller", "position"], "controllers are mine.py:Down, not position"),
        ([*first, "--border"], "--seeds, --case would"), ([*words, "--border"], "a score, not a border"),
        ([*words, "--worst", "30"], "a score, not a search of the worst"), (first, "have changed"),
    ):  # fmt: skip
        if asked is first:
            Path("mine.py").write_text(source.replace("t.twist", "0.5 * t.twist"))
        assert_refused(polish_sim(*asked), said, "mine.py", "s")
        assert {file.name: file.read_bytes() for file in Path("s").iterdir()} == whole
    done(polish_sim(*first, "--overwrite"))
    assert Path("s/score.json").read_bytes() != whole["score.json"]


def planted(task):
    """A row whose figures follow from the scenario alone, quickly."""
    scenario = task.scenario
    feed, off = scenario.process.feed_m_s, scenario.part.displacement_m
    figures = {"largest_force_n": 20.0 + 1e3 * off, "contact_lost_s": max(0.0, feed - 0.03)}
    return {"max_error_n": 1e3 * abs(feed - 0.02), "protective_stop": None, "duration": 2.0} | figures


def pressed(_bench, scenario):
    late = scenario.sensor.latency_s + scenario.robot.command_latency_s
    return Rest(late < 0.03, late * scenario.head.spring_scale < 0.04, late, 0.0, 0.0)


@pytest.mark.parametrize(("how", "file"), [("--worst 100", "metrics.json"), ("--border", "border.json")])
def test_an_interrupted_search_resumes_to_the_table_of_a_whole_one(how, file, polish_sim, monkeypatch):
    words, left = ["score", *how.split(), "--set", "sensor.force_noise_n=0.1", *HERE, "--out"], [40]

    def counted(measure):
        def measured(*asked):
            left[0] -= 1
            if left[0] == -1:
                raise KeyboardInterrupt
            return measure(*asked)

        return measured

    monkeypatch.setattr(score, "_measure", counted(planted))
    monkeypatch.setattr("polish_sim.scoring.border.press_bench", counted(pressed))
    monkeypatch.setattr("polish_sim.scoring.border.build_bench", lambda _: None)
    monkeypatch.setattr("polish_sim.scoring.border.longest_stable", lambda _: 0.03)
    cut = polish_sim(*words, "cut")
    refused(cut, "interrupted: what follows is of the runs done so far", code=130)
    assert "--out cut resumes" in cut.err.splitlines()[-1]
    if file == "border.json":  # the shortest five of eight latencies are done: 0.03 s is the next
        line = next(line for line in cut.out.splitlines() if " x " in line)
        assert line.split()[:4] == ["0.2", "x", ">=", "20"]
    assert Path("cut/rows.jsonl").read_bytes().count(b"\n") == 40
    again = polish_sim(*words, "cut")
    measured = 40 - left[0]
    whole = polish_sim(*words, "whole")
    assert (again.code, whole.code) == (0, 0)
    assert again.out.replace("cut", "whole") == whole.out
    assert read_json(Path("cut") / file) == read_json(Path("whole") / file)
    rows = [Path(folder, "rows.jsonl").read_text().splitlines() for folder in ("cut", "whole")]
    assert rows[0] == rows[1]
    assert measured == 41 + len(rows[1]) - 40 - 21 * (file == "border.json")  # none a second time
