"""Every format by name, from Python and from the command line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from polish_sim.errors import InputError, PlanError
from polish_sim.exchange import FORMATS, check_formats, export_plan, read_path
from polish_sim.planning.toolpath import RETRACT
from tests.cli.conftest import polish_sim
from tests.planning.shapes import shipped_plan

__all__ = ["polish_sim"]
Polish = Callable[..., tuple[int, str, str]]


def test_all_means_every_format_once(tmp_path):
    files = export_plan(tmp_path, shipped_plan("sphere_100"), ["html", "all", "html"])
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(known.file for known in FORMATS.values())
    assert len(files) == len(FORMATS)
    assert all(file.stat().st_size > 1000 for file in files)


def test_names_are_kept_in_order_and_unknown_ones_refused():
    assert check_formats(["ply", "apt", "ply"]) == ("ply", "apt")
    with pytest.raises(InputError, match=r"unknown export format 'step'. Known: all, apt, csv, glb"):
        check_formats(["apt", "step"])


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_plan_gives_the_same_bytes(tmp_path, name):
    for folder in ("one", "two"):
        export_plan(tmp_path / folder, shipped_plan("sphere_100"), [name])
    one, two = (next((tmp_path / folder).iterdir()).read_bytes() for folder in ("one", "two"))
    assert one == two


@pytest.mark.parametrize("name", ["csv", "json", "apt"])
def test_what_is_exported_is_read_by_the_one_reader(tmp_path, name):
    path = shipped_plan("sphere_100").path
    (file,) = export_plan(tmp_path, shipped_plan("sphere_100"), [name])
    back = read_path(file)
    assert back.positions_work[back.process] == pytest.approx(path.positions_work[path.process], abs=1e-9)


def test_a_path_that_touches_nothing_is_no_robot_program(tmp_path):
    result = shipped_plan("sphere_100")
    path = replace(result.path, segment=np.full(len(result.path.s), RETRACT, dtype=np.int8))
    with pytest.raises(PlanError, match="no process point"):
        export_plan(tmp_path, replace(result, path=path), ["urscript"])
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_writes_what_is_asked_for(polish_sim: Polish) -> None:
    words = ("--export", "urscript", "--export", "html", "--set", "part.pose=[0.4, 0, 0.1, 0, 0, 0]")
    assert polish_sim("plan", "sphere_100", *words, "--contact-force", "12", "--out", "plan")[0] == 0
    assert {"path.script", "path.html", "path.csv", "path.png"} <= {file.name for file in Path("plan").iterdir()}
    script = Path("plan/path.script").read_text()
    assert "global T_base_work = p[0.4, 0, 0.1, 0, 0, 0]" in script
    assert "global part_is_placed = True" in script
    assert "global force_n = 12 " in script


def test_an_unknown_export_is_one_message_and_nothing_is_written(polish_sim: Polish) -> None:
    code, _, err = polish_sim("plan", "sphere_100", "--export", "step", "--out", "plan")
    assert code == 2
    assert "unknown export format 'step'" in err
    assert not Path("plan").exists()
