"""Studies: what is varied makes the runs it should, and rows stay whole whatever happens to the command."""

from dataclasses import replace

import numpy as np
import pytest

from polish_sim.analysis.claim import Claim
from polish_sim.errors import PolishSimError
from polish_sim.experiments.assembly import config_hash
from polish_sim.experiments.registry import default_scenario
from polish_sim.row_file import Rows, locked
from polish_sim.scenario_file import FILE_KEYS, override
from polish_sim.studies.page import pareto, sweep_page
from polish_sim.studies.study import Axis, Study, read_axis, read_study, study_text
from polish_sim.studies.table import DONE, FAILED, LOST, RunTable, keys_of_runs, read_rows, run_study
from polish_sim.workers import Here, Result, Runner

pytest.importorskip("pyarrow")
ARC = override(default_scenario("arc"), ["process.max_feed_s=0.05", "process.feed_m_s=0.1"])
NOISE = "sensor.force_noise_n"


def study(*axes, **more):
    return Study(ARC, tuple(map(read_axis, axes)), **more)


class Deadly(Here):
    """The first task kills its worker."""

    def results(self, tasks, work, group_of):
        yield Result(tasks[0], None, "a worker process was killed")
        yield from super().results(tasks[1:], work, group_of)


def test_an_axis_is_a_range_or_values_and_a_grid_every_combination_with_every_seed():
    assert read_axis("a.b=0.001:10:log5").values == (0.001, 0.01, 0.1, 1.0, 10.0)
    assert read_axis("a.b=0:1:lin5").values == (0.0, 0.25, 0.5, 0.75, 1.0)
    assert read_axis("a=1, 2.5,true,word").values == (1, 2.5, True, "word")
    assert read_axis("a=mine.py:Mine,other.py:Mine").values == ("mine.py:Mine", "other.py:Mine")
    assert read_axis("a=mine.py:Mine").values == ("mine.py:Mine",)
    assert read_axis("a=[[1, 2], [3, 4]]").values == ((1, 2), (3, 4))
    axis = Axis("a", "", ("x", "y", "z"))  # of a sample
    assert [axis.at(u) for u in (0.0, 0.33, 0.34, 0.66, 0.67, 0.999)] == ["x", "x", "y", "y", "z", "z"]
    for text in ("a", "a=1,,2", "a=2:1:lin3", "a=0:1:log3", "a=1:2:lin1", "a=[1,", "a=[]"):
        with pytest.raises(PolishSimError, match="--vary"):
            read_axis(text)
    made = list(study(f"{NOISE}=0.1,0.5", "process.feed_m_s=0.1:0.3:lin3", seeds=4).runs())
    assert len(made) == len(set(made)) == 2 * 3 * 4
    assert {run.seed for run in made} == {0, 1, 2, 3}


@pytest.mark.parametrize("sample", ["random", "sobol", "lhs"])
def test_samples_stay_in_their_ranges_and_come_again(sample):
    axes = f"{NOISE}=0.1:0.5", "process.feed_m_s=0.001:0.1:log", "controller.name=a,b"
    asked = study(*axes, sample=sample, count=24)
    points = asked.points()
    assert points == asked.points()
    assert len(set(points)) == 24
    assert all(0.1 <= a < 0.5 and 0.001 <= b < 0.1 and c in "ab" for a, b, c in points)
    if sample == "lhs":  # one point in each twenty-fourth of every axis
        assert sorted(int(24 * np.log10(b / 0.001) / 2) for _, b, _ in points) == list(range(24))


@pytest.mark.parametrize(
    ("axes", "more", "told"),
    [
        ([f"{NOISE}=0.1,0.2", f"{NOISE}=0.3"], {}, "varied twice"), (["seed=1,2"], {}, "--seeds"),
        ([f"{NOISE}=0.1:0.2"], {}, "a grid needs steps"), ([f"{NOISE}=0.1"], {"count": 3}, "--count is for"),
        ([f"{NOISE}=0.1:0.2"], {"sample": "sobol"}, "needs --count"), ([f"{NOISE}=0.1,-3"], {}, "outside"),
        ([f"{NOISE}=0.1"], {"sample": "sobl", "count": 3}, "'sobol'"),
        (["sensor.force_nose_n=0.1"], {}, "'sensor.force_noise_n'"),
        ([f"{NOISE}=0:1:lin100000"], {"seeds": 1000}, "more than"),
    ],
)  # fmt: skip
def test_a_study_no_run_can_be_made_of_is_refused(axes, more, told):
    with pytest.raises(PolishSimError, match=told):
        study(*axes, **more).check()


def test_a_study_s_file_gives_back_the_same_runs(tmp_path):
    axes = f"{NOISE}=0.1:0.5:log3", "controller.name=hybrid-pi,position", "part.pose=[[0,0,0,0,0,0]]"
    asked = study(*axes, seeds=2)
    asked = replace(asked, base=replace(asked.base, seed=7))
    (tmp_path / "study.toml").write_text(study_text(asked))
    again = read_study(tmp_path / "study.toml")
    assert list(again.runs()) == list(asked.runs())
    assert again.base == asked.base


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("experiment = 'arc'\nsed = 3", "'seeds'"), ("experiment = 'ark'", "'arc'"),
        ("experiment = 'arc'\n[settings]\nexperiment = 'force'", "leave the setting experiment=force out"),
        ("experiment = 'arc'\nseeds = 'many'", "'seeds' must be a whole number"),
        ("experiment = 'arc'\nvary = 3", "'vary' are sections"), ("experiment = ", "not valid TOML"),
        ("experiment = 'arc'\n[vary]\nsensor.force_noise_n = []", "must be a list"),
        ("experiment = 'arc'\n[settings]\nsensor.force_nose_n = 1", "'sensor.force_noise_n'"),
    ],
)  # fmt: skip
def test_a_study_s_file_edited_wrongly_is_refused(tmp_path, text, told):
    (tmp_path / "study.toml").write_text(text)
    with pytest.raises(PolishSimError, match=told):
        read_study(tmp_path / "study.toml").check()


@pytest.mark.parametrize("key", ["plan.file", *FILE_KEYS, "controller.name"])
def test_a_key_that_names_a_file_counts_by_the_file_s_content(key, tmp_path):
    hashes = []
    for folder, text in (("x", "a"), ("y", "a"), ("x", "b")):
        file = tmp_path / folder / "file.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
        value = f"{file}:Mine" if key == "controller.name" else file
        hashes.append(config_hash(override(ARC, [f"{key}={value}"]), {}))
    assert hashes[0] == hashes[1] != hashes[2]
    assert config_hash(override(ARC, ["process.feed_m_s=0.2"]), {}) != config_hash(ARC, {})


def test_rows_come_to_the_table_once_and_a_lost_run_is_done_again(tmp_path):
    asked = study(f"{NOISE}=0.1,0.5", "controller.name=hybrid-pi,nobody", seeds=1)
    keys = keys_of_runs(asked)
    runner = Runner(RunTable(tmp_path), Deadly())
    assert run_study(asked, keys, False, runner)["lost"] == runner.lost == 1
    assert sorted(RunTable(tmp_path).known.values()) == [DONE, FAILED, FAILED, LOST]
    with (tmp_path / "rows.jsonl").open("a") as file:
        file.write('{"key": "torn')
    with locked(tmp_path / "rows.jsonl"):
        again = Runner(RunTable(tmp_path), Here())
        assert len(again.kept.missing(keys)) == 1
        run_study(asked, keys, False, again)
    assert again.lost == 0
    columns = read_rows(tmp_path)
    assert sorted(columns["outcome"]) == [DONE, DONE, FAILED, FAILED]
    assert len(set(columns["config_hash"])) == 4
    assert sorted(columns[NOISE]) == [0.1, 0.1, 0.5, 0.5]
    assert all(("nobody" in str(reason)) == (outcome == FAILED)
               for reason, outcome in zip(columns["reason"], columns["outcome"], strict=True))  # fmt: skip
    page = sweep_page(asked, columns)
    assert page.title == "sweep: sensor.force_noise_n, controller.name"
    assert dict(page.tables["Ended"])[DONE] == "2"


def test_a_torn_line_of_any_length_is_cut_off_and_a_row_edited_or_of_another_work_does_not_count(tmp_path):
    table = RunTable(tmp_path)
    table.add("a", {"config_hash": "a", "seed": 0, "outcome": DONE, "text": "x" * (17 << 20)})
    whole = table.path.read_bytes()
    table.path.write_bytes(whole + whole[:-1])
    with locked(table.path):
        assert table.path.read_bytes() == whole
    (other := tmp_path / "other").mkdir()
    table = RunTable(other)
    for name in "abc":
        table.add(name, {"config_hash": name, "seed": 0, "outcome": DONE, "force_mean_n": 20.0})
    table.path.write_text(table.path.read_text().replace("20.0", "[20.0]", 1))
    Rows(other).add("d", {"case": "step-20"})
    again = RunTable(other)
    assert set(again.known) == {"b", "c"}
    again.write()
    assert read_rows(other)["force_mean_n"] == [20.0, 20.0]


def test_the_front_is_the_points_none_beats_in_both():
    x, y = [1, 2, 3, 2, 1, 4], [3, 2, 1, 3, 4, 0]
    columns = {"a": list(range(6)), "x": x, "y": y, "outcome": [DONE] * 5 + [FAILED]}
    goals = [Claim("x", "x", ""), Claim("y", "y", "")]
    assert [point[0] for point, _, best in pareto(columns, ["a"], goals) if best] == [0, 1, 2]
    worst_first = [goals[0]._replace(more_is_better=True), goals[1]]
    assert [point[0] for point, _, best in pareto(columns, ["a"], worst_first) if best] == [2]
