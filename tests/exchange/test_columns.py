"""CSV and JSON beyond what `plan` writes: force and feed, other programs' habits, damaged files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from polish_sim.errors import InputError, PolishSimError
from polish_sim.exchange import READERS, ExportSetup, export_plan, read_path, write_plan
from tests.planning.shapes import shipped_plan

PLAIN = "x,y,z,i,j,k,force,feed\n0,0,20,0,0,1,12,10\n10,0,20,0,0,1,15,20\n"


def test_force_and_feed_of_a_plain_file_are_newtons_and_millimetres_per_second(tmp_path):
    file = tmp_path / "plain.csv"
    file.write_text(PLAIN)
    path = read_path(file)
    assert path.force == pytest.approx([12.0, 15.0])
    assert path.feed == pytest.approx([0.01, 0.02])


@pytest.mark.parametrize("name", ["path.csv", "path.json"])
def test_force_and_feed_of_the_waypoints_come_back_bit_for_bit(tmp_path, name):
    result = shipped_plan("sphere_100")
    count = len(result.path.s)
    path = replace(result.path, force=np.linspace(5.0, 25.0, count), feed=np.linspace(0.005, 0.02, count))
    write_plan(tmp_path, replace(result, path=path))
    back = read_path(tmp_path / name)
    assert np.array_equal(back.force, path.force)
    assert np.array_equal(back.feed, path.feed)


def test_a_path_without_force_and_feed_has_no_such_columns(tmp_path):
    write_plan(tmp_path, shipped_plan("sphere_100"))
    assert "force" not in (tmp_path / "path.csv").read_text().splitlines()[0]
    assert read_path(tmp_path).force is None


def test_byte_order_marks_blank_lines_comments_and_capitals_do_no_harm(tmp_path):
    file = tmp_path / "plain.csv"
    text = "# made elsewhere\r\n\r\nX, Y, Z, I, J, K\r\n0,0,20,0,0,1\r\n\r\n# half way\r\n10,0,20,0,0,1\r\n"
    file.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert read_path(file).length_m == pytest.approx(0.01)


def test_lines_are_counted_as_an_editor_counts_them(tmp_path):
    file = tmp_path / "plain.csv"
    file.write_text("# made elsewhere\n\nx,y,z,i,j,k\n0,0,20,0,0,1\n\n10,0,oops,0,0,1\n")
    with pytest.raises(InputError, match="line 6, point 2: z is 'oops'"):
        read_path(file)


HEAD = "x,y,z,i,j,k,force,feed\n0,0,20,0,0,1,12,10\n"
OWN = "s_m,x_m,y_m,z_m,nx,ny,nz,pass_index,segment\n0,0,0,0,0,0,1,0,process\n"
BAD = {
    "no force": (HEAD + "1,0,20,0,0,1,0,10\n", "line 3, point 2: force is 0"),
    "pulling": (HEAD + "1,0,20,0,0,1,-3,10\n", "line 3, point 2: force is -3"),
    "standing still": (HEAD + "1,0,20,0,0,1,5,0\n", "line 3, point 2: feed is 0"),
    "infinite": (HEAD + "1,0,inf,0,0,1,5,1\n", "line 3, point 2: z is 'inf'"),
    "a zero axis": (HEAD + "1,0,20,0,0,0,5,1\n", "line 3, point 2: the tool axis .* length 0"),
    "metres for millimetres": (HEAD + "1e6,0,20,0,0,1,5,1\n", "line 3, point 2: a coordinate beyond"),
    "a part of a pass": (OWN + "1,1,0,0,0,0,1,0.5,process\n", "line 3, point 2: pass_index is '0.5'"),
    "an unknown segment": (OWN + "1,1,0,0,0,0,1,0,jump\n", "line 3, point 2: unknown segment 'jump'"),
    "a column twice": ("x,y,z,i,j,k,x\n0,0,20,0,0,1,3\n", "line 1: the header names x more than once"),
    "a huge field": ('x,y,z,i,j,k\n"' + 200_000 * "1" + '",0,0,0,0,1\n', "not CSV"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_value_is_named_with_its_line(tmp_path, case):
    text, message = BAD[case]
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        read_path(file)


def test_columns_of_unequal_length_are_named(tmp_path):
    write_plan(tmp_path, shipped_plan("sphere_100"))
    document = json.loads((tmp_path / "path.json").read_text())
    document["path"]["nx"].pop()
    (tmp_path / "path.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="unequal length"):
        read_path(tmp_path)


def test_a_file_of_no_path_format_is_refused_with_the_formats_that_are(tmp_path):
    file = tmp_path / "part.stl"
    file.write_text("solid")
    with pytest.raises(InputError, match=r"\.stl.*\.apt.*\.csv"):
        read_path(file)


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_a_damaged_file_is_a_path_or_one_message(tmp_path, suffix):
    """150 files with bytes changed, cut, doubled: never a traceback."""
    rng = np.random.default_rng(7)
    export_plan(tmp_path, shipped_plan("sphere_100"), ["csv", "json", "apt"], ExportSetup())
    kind = {".json": "path.json", ".csv": "path.csv", ".txt": "path.csv"}.get(suffix, "path.apt")
    lines = (tmp_path / kind).read_bytes().splitlines()
    whole = b"\n".join([*lines[:12], *lines[-3:]]) if suffix != ".json" else _short_json(tmp_path / kind)
    file = tmp_path / f"damaged{suffix}"
    messages = []
    for _ in range(150):
        content = bytearray(whole)
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(0, len(content)))
            content[at : at + int(rng.integers(0, 9))] = rng.integers(
                0, 256, int(rng.integers(0, 6)), np.uint8
            ).tobytes()
        file.write_bytes(bytes(content))
        try:
            read_path(file)
        except PolishSimError as error:
            messages.append(str(error))
    assert len(messages) > 20
    assert all(str(file) in message for message in messages)


def _short_json(file):
    document = json.loads(file.read_text())
    table = {name: column[:8] for name, column in document["path"].items()}
    return json.dumps({"path": table}).encode()
