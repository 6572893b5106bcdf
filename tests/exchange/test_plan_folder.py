"""Plans on disk: what was written is read back; what cannot be read is one clear message."""

from __future__ import annotations

import csv
import json
from dataclasses import fields

import numpy as np
import pytest

from polish_sim.errors import InputError
from polish_sim.exchange import read_path, write_plan
from polish_sim.planning.toolpath import PROCESS
from tests.planning.shapes import shipped_plan


@pytest.fixture
def folder(tmp_path):
    write_plan(tmp_path / "plan", shipped_plan("sphere_100"))
    return tmp_path / "plan"


@pytest.mark.parametrize("name", ["", "path.json", "path.csv"])
def test_a_written_path_reads_back_bit_for_bit(folder, name):
    path, back = shipped_plan("sphere_100").path, read_path(folder / name)
    for field in fields(path):
        wanted, found = getattr(path, field.name), getattr(back, field.name)
        if wanted is None:
            assert found is None
            continue
        assert found.dtype == wanted.dtype
        # The arc length is summed anew, axes are brought to length one anew.
        assert np.abs(found - wanted).max() < 1e-12, field.name


def test_the_files_hold_what_the_contract_names(folder):
    assert sorted(file.name for file in folder.iterdir()) == ["metrics.json", "path.csv", "path.json"]
    with (folder / "path.csv").open() as file:
        header = next(csv.reader(file))
    assert header[:9] == ["s_m", "x_m", "y_m", "z_m", "nx", "ny", "nz", "pass_index", "segment"]
    metrics = json.loads((folder / "metrics.json").read_text())
    wanted = "facets fit_rms_m path_length_m cycle_time_s stepover_mean_m stepover_p5_m stepover_p95_m coverage "
    wanted += "coverage_stepover self_crossings retracts max_distance_to_surface_m plan_time_s stepover_excluded"
    assert set(wanted.split()) <= set(metrics)
    document = json.loads((folder / "path.json").read_text())
    assert document["part"]["sha256"] == shipped_plan("sphere_100").mesh.sha256
    assert document["part"]["unit"] == "mm"
    assert document["pattern"] == "spiral"
    assert document["stepover_m"] == 0.008
    assert document["up"] == [0.0, 0.0, 1.0]


def test_a_plain_path_in_millimetres_is_read(tmp_path):
    file = tmp_path / "plain.csv"
    file.write_text("x,y,z,i,j,k\n0,0,20,0,0,1\n10,0,20,0,0,1\n10, 5,20,0,0.6,0.8\n")
    path = read_path(file)
    assert path.positions_work[2] == pytest.approx([0.01, 0.005, 0.02])
    assert path.axes_work[2] == pytest.approx([0.0, 0.6, 0.8])
    assert path.s == pytest.approx([0.0, 0.01, 0.015])
    assert (path.segment == PROCESS).all()


HEADER = "x,y,z,i,j,k\n"
BAD = {
    "empty": ("", "holds no points"),
    "only a header": (HEADER, "holds no points"),
    "wrong columns": ("a,b\n1,2\n", "columns a, b"),
    "a short row": (HEADER + "0,0,0,0,0,1\n1,2\n", "line 3: 2 values"),
    "a word": (HEADER + "0,0,0,0,0,1\n1,0,zero,0,0,1\n", "point 2: z is 'zero'"),
    "not a number": (HEADER + "0,0,0,0,0,1\n1,0,nan,0,0,1\n", "point 2: z is 'nan'"),
    "an axis too long": (HEADER + "0,0,0,0,0,1\n1,0,0,0,0,2\n", "point 2: the tool axis"),
    "a repeated point": (HEADER + "0,0,0,0,0,1\n0,0,0,0,0,1\n", "points 1 and 2 are the same"),
    "one point": (HEADER + "0,0,0,0,0,1\n", "one point"),
    "an unknown segment": (
        "s_m,x_m,y_m,z_m,nx,ny,nz,pass_index,segment\n0,0,0,0,0,0,1,0,jump\n1,1,0,0,0,0,1,0,process\n",
        "unknown segment 'jump'",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_named_with_the_place(tmp_path, case):
    text, message = BAD[case]
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_path(file)
    assert "bad.csv" in str(caught.value)


@pytest.mark.parametrize(("text", "message"), [("{", "not JSON"), ("[1, 2]", "holds no path"), ("{}", "holds no path")])
def test_a_bad_json_is_named(tmp_path, text, message):
    file = tmp_path / "bad.json"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        read_path(file)


def test_a_missing_or_foreign_source_is_named(tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        read_path(tmp_path / "nothing.csv")
    with pytest.raises(InputError, match="not a plan folder"):
        read_path(tmp_path)
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(InputError, match="not a text file"):
        read_path(tmp_path / "picture.csv")


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write the plan"):
        write_plan(tmp_path / "file" / "plan", shipped_plan("sphere_100"))
