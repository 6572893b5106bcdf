"""A run written to disk reads back as it was."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from polish_sim.analysis.run_record import RunRecord, package_versions, read_record, write_json, write_record
from polish_sim.config import Scenario
from polish_sim.errors import InputError
from tests.analysis.synthetic import bumpy_path, log_of, surface_trace


@pytest.fixture
def record() -> RunRecord:
    scenario = replace(Scenario(), seed=7)
    path = bumpy_path(bumps=2, length=0.1)
    return RunRecord("run", scenario, {"force_mean_n": 20.0, "seed": 7}, log_of(surface_trace(path)), path)


def test_a_run_reads_back_as_it_was_written(record: RunRecord, tmp_path: Path) -> None:
    write_record(tmp_path, record)
    back = read_record(tmp_path)
    assert back.scenario == record.scenario
    assert back.metrics == record.metrics
    assert back.path is not None
    assert record.path is not None
    np.testing.assert_array_equal(back.path.curvature, record.path.curvature)
    for name in record.log.names:
        np.testing.assert_array_equal(back.log[name], record.log[name])


def test_an_undefined_figure_is_null_and_the_file_is_strict_json(tmp_path: Path) -> None:
    figures = {"a": math.nan, "b": np.float64(2.0), "c": np.int64(3), "d": [math.inf, 1.0], "e": np.array([1.0])}
    write_json(tmp_path / "metrics.json", figures)

    def refuse(text: str) -> float:
        raise AssertionError(f"{text} is not JSON")

    read = json.loads((tmp_path / "metrics.json").read_text(), parse_constant=refuse)
    assert read == {"a": None, "b": 2.0, "c": 3, "d": [None, 1.0], "e": [1.0]}


def test_a_folder_that_is_no_run_is_refused_naming_what_it_lacks(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"lacks config.toml, metrics.json, log.npz"):
        read_record(tmp_path)


@pytest.mark.parametrize("name", ["metrics.json", "log.npz", "path.npz"])
def test_a_truncated_file_is_refused_by_name(record: RunRecord, tmp_path: Path, name: str) -> None:
    write_record(tmp_path, record)
    file = tmp_path / name
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(InputError, match=name):
        read_record(tmp_path)


def test_the_versions_name_the_engine_and_ourselves() -> None:
    assert {"python", "polish-sim", "mujoco", "numpy"} <= set(package_versions())
