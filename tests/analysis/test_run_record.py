"""Saved runs read back, and what is said of them side by side."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from polish_sim.analysis import run_record
from polish_sim.config import Scenario
from polish_sim.errors import ConfigError, InputError
from polish_sim.experiments.registry import setting_rows
from polish_sim.scenario_file import merge
from tests.analysis.synthetic import bumpy_path, log_of, removal_map, surface_trace, trace_of


@pytest.fixture
def record():
    scenario = replace(Scenario(), seed=7)
    path, removal = bumpy_path(bumps=2, length=0.1), removal_map(np.ones(5))
    log = log_of(surface_trace(path))
    return run_record.RunRecord("run", scenario, {"force_mean_n": 20.0, "seed": 7}, log, path, removal)


def test_a_run_reads_back_as_written_in_strict_json_with_null_for_an_undefined_figure(record, tmp_path):
    run_record.write_record(tmp_path, record)
    back = run_record.read_record(tmp_path)
    assert (back.scenario, back.metrics) == (record.scenario, record.metrics)
    np.testing.assert_array_equal(back.path.curvature, record.path.curvature)
    for name in record.log.names:
        np.testing.assert_array_equal(back.log[name], record.log[name])
    numpys = {"b": np.float64(2.0), "c": np.int64(3), "e": np.array([1.0])}
    run_record.write_json(tmp_path / "metrics.json", {"a": math.nan, "d": [math.inf, 1.0], **numpys})
    read = json.loads((tmp_path / "metrics.json").read_text(), parse_constant=pytest.fail)
    assert read == {"a": None, "b": 2.0, "c": 3, "d": [None, 1.0], "e": [1.0]}


@pytest.mark.parametrize(
    ("figure", "value"),
    [
        ("protective_stop_at", {"name": "x", "time_s": "1", "path_s_m": 0.1, "tool_m": [0, 0, 0]}),
        ("protective_stop_at", {"name": "x", "time_s": 1.0}), ("T_base_work", [[0.0] * 4] * 4),
        ("T_base_work", [[1.0, 0.0], [0.0, 1.0]]), ("protective_stop", ["no text"]), ("versions", "1.0"),
        ("bad_figures", "x"), ("seed", [1]),
    ],
)  # fmt: skip
def test_an_entry_of_metrics_that_was_edited_is_refused_by_name(record, tmp_path, figure, value):
    run_record.write_record(tmp_path, replace(record, metrics={**record.metrics, figure: value}))
    with pytest.raises(InputError, match=rf"'{figure}' in '.*metrics.json'.*Delete the entry"):
        run_record.read_record(tmp_path)


def test_a_run_that_pressed_on_nothing_is_read(record, tmp_path):
    idle = replace(record.removal, unplaced_share=np.nan, field_ratio=np.nan)
    run_record.write_record(tmp_path, replace(record, removal=idle))
    assert np.isnan(run_record.read_record(tmp_path).removal.unplaced_share)


@pytest.mark.parametrize(
    ("name", "array", "change"),
    [
        ("log.npz", "normal_force_n", lambda column: column[:-3]),
        ("log.npz", "q_rad", lambda column: column[:, :4]),
        ("log.npz", "time_s", lambda column: np.full(len(column), "a")),
        ("log.npz", "time_s", lambda column: np.array(1.0)),
        ("log.npz", "torque_nm", lambda column: column * np.nan),
        ("log.npz", "tcp_quaternion_wxyz", np.zeros_like),
        ("path.npz", "curvature", lambda column: column * np.nan),
        ("removal.npz", "triangles", lambda triangles: triangles + 1000),
        ("removal.npz", "exposure", lambda exposure: exposure[:-1]), ("removal.npz", "areas", np.zeros_like),
        ("removal.npz", "exposure", np.negative), ("removal.npz", "preston_1_pa", np.atleast_1d),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_refused_by_file(record, tmp_path, name, array, change):
    run_record.write_record(tmp_path, record)
    with np.load(tmp_path / name) as read:
        arrays = dict(read)
    np.savez(tmp_path / name, **arrays | {array: change(arrays[array])})
    with pytest.raises(InputError, match=rf"cannot read the .*{name}"):
        run_record.read_record(tmp_path)
    np.savez(tmp_path / name, **{key: column for key, column in arrays.items() if key != array})
    with pytest.raises(InputError, match=rf"cannot read the .*{name}': it lacks {array}\."):
        run_record.read_record(tmp_path)


def test_a_folder_that_is_no_run_or_holds_a_truncated_file_is_refused_by_name(record, tmp_path):
    with pytest.raises(InputError, match=r"lacks config.toml, metrics.json, log.npz"):
        run_record.read_record(tmp_path)
    run_record.write_record(tmp_path, replace(record, metrics={**record.metrics, "files": ["path.npz"]}))
    for name in ("metrics.json", "log.npz", "path.npz", run_record.REMOVAL, "config.toml"):
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(whole[: len(whole) // 2] if name != "config.toml" else b"")
        with pytest.raises(InputError, match=name) as refused:
            run_record.read_record(tmp_path)
        (tmp_path / name).write_bytes(whole)
    assert "config.toml' is not the config of a run" in str(refused.value)
    lines = whole.splitlines(keepends=True)
    (tmp_path / name).write_bytes(b"".join(lines[:-30]))
    with pytest.raises(ConfigError, match="was cut"):
        run_record.read_record(tmp_path)
    (tmp_path / name).write_bytes(b"".join(lines[1:-1]))  # as a user's own
    assert run_record.read_record(tmp_path).scenario == record.scenario
    (tmp_path / "path.npz").unlink()
    with pytest.raises(InputError, match=r"lacks path\.npz\."):
        run_record.read_record(tmp_path)


def run(name="run", metrics=None, **sections):
    scenario, log = merge(Scenario(), dict(sections), ""), log_of(trace_of(np.zeros(4, np.int8)))
    return run_record.RunRecord(name, scenario, {"path_done": 1.0} | (metrics or {}), log, None)


def test_settings_ends_and_differences_of_runs_side_by_side_are_said_and_their_names_differ(tmp_path):
    stopped = {"path_done": 0.5, "protective_stop": "the force was too large"}
    for metrics, said in (
        ({}, "whole"), ({"path_done": 0.351, "interrupted": True}, "interrupted at 35.1%"),
        (stopped, "stopped at 50.0%"), ({"path_done": 0.25}, "cut short at 25.0%"),
    ):  # fmt: skip
        assert run_record.ending(run(metrics=metrics)) == said
    other = replace(run(controller={"name": "position", "force_p_m_sn": 0.001}).scenario, seed=7)
    assert run_record.notes_of([run(), replace(run(), scenario=other)]) == []
    (note,) = run_record.notes_of([run("a"), run("b", stopped)])
    assert note.startswith("'b' stopped at 50.0% (the force was too large)")
    (note,) = run_record.notes_of([run(), run(), run(part={"file": "plate"}, sensor={"force_noise_n": 1.0})])
    assert note.endswith("they differ in part.file, sensor.force_noise_n.")
    bowl = {"part": {"file": "my/bowl.stl"}, "process": {"contact_force_n": 12.0, "feed_m_s": 0.04}}
    teach, rim = {"experiment": "teach"}, {"experiment": "teach", "drag": {"follow": "rim"}}
    for runs, wanted in (
        ([{}, bowl], {"part": ["freeform", "bowl.stl"], "set force": ["20", "12"], "feed": ["10", "40"]}),
        ([{}, {"plan": {"file": "mine.csv"}}], {"path": ["spiral", "mine.csv"], "step-over": ["8", "-"]}),
        ([teach, rim], {"along": ["the trial's moves", "rim"], "mode": ["every", "default"]}),
        ([{"experiment": "dual"}], {"path": ["around the rim"]}),
    ):
        rows = {label: found for label, _, *found in setting_rows([run(**sections) for sections in runs])}
        assert wanted.items() <= rows.items()
    folders = [tmp_path / "first" / "seed-0000", tmp_path / "second" / "seed-0000"]
    for folder in folders:
        folder.mkdir(parents=True)
        run_record.write_record(folder, run())
    assert [record.name for record in run_record.read_records(folders)] == [str(folder) for folder in folders]
    assert len({record.name for record in run_record.read_records([folders[0], folders[0]])}) == 2
    assert [record.name for record in run_record.read_records(folders[:1])] == ["seed-0000"]
