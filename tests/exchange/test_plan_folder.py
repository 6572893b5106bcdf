"""Plan folders and exports: written, read back, refused with the place."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from polish_sim.errors import InputError, PlanError
from polish_sim.exchange import FORMATS, ExportSetup, RobotTool, check_formats, export_plan, read_path, write_plan
from polish_sim.models import robot_model_path
from polish_sim.planning.toolpath import PROCESS, RETRACT
from tests.cli.conftest import polish_sim
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
    "beyond what is measured": (HEADER + "0,0,0,0,0,1\n1,0,-1e300,0,0,1\n", "point 2: z is '-1e300', beyond 1e\\+12"),
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


def test_the_default_tool_is_that_of_the_shipped_cell():
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = [model.body(name).id for name in ("tool_mount", "head")]
    mass = model.body_mass[bodies]
    flange = data.site("flange")
    middle = flange.xmat.reshape(3, 3).T @ ((mass @ data.xipos[bodies]) / mass.sum() - flange.xpos)
    tcp = flange.xmat.reshape(3, 3).T @ (data.site("tool").xpos - flange.xpos)
    tool = RobotTool()
    assert tool.payload_kg == pytest.approx(mass.sum())
    assert tool.payload_center_m == pytest.approx(middle, abs=1e-4)
    assert tool.tcp_pose == pytest.approx([*tcp, 0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("pose", [(0.1, 0.2, 0.3), (0.0,) * 5 + (np.nan,)])
def test_half_a_pose_is_refused(pose):
    with pytest.raises(InputError, match=r"part_pose .* is no pose"):
        ExportSetup(part_pose=pose)
    with pytest.raises(InputError, match=r"tool\.tcp_pose .* is no pose"):
        ExportSetup(tool=RobotTool(tcp_pose=pose))


@pytest.mark.parametrize(("name", "comment"), [("apt", "$$"), ("urscript", "#"), ("ros", "#")])
def test_programs_say_where_the_tool_is_in_the_part(tmp_path, name, comment):
    plan = shipped_plan("plate")
    middle = plan.path.positions_work[plan.path.process].mean(axis=0)
    near = plan.path.process & (np.linalg.norm(plan.path.positions_work - middle, axis=1) < 0.01)
    (file,) = export_plan(tmp_path, replace(plan, in_part=plan.path.positions_work[near]), [name])
    lines = [line.strip() for line in file.read_text().splitlines()]
    begins = [k for k, line in enumerate(lines) if line == f"{comment} the tool is in the part from here"]
    ends = [k for k, line in enumerate(lines) if line == f"{comment} the tool is in the part up to here"]
    assert len(begins) > 0
    assert len(begins) - len(ends) in (0, 1)  # a stroke may end in the part
    assert all(begin < end for begin, end in zip(begins, ends, strict=False))
    if name == "apt":
        marked = [line for a, b in zip(begins, ends, strict=False) for line in lines[a:b] if line.startswith("GOTO/")]
        marked += [line for line in lines[begins[-1] :] if len(begins) > len(ends) and line.startswith("GOTO/")]
        points = 1e-3 * np.array([[float(x) for x in line[5:].split(",")[:3]] for line in marked])
        assert np.linalg.norm(points - middle, axis=1).min() < 0.01
        assert len(read_path(file).s) > len(points)
    (clean,) = export_plan(tmp_path / "clean", plan, [name])
    assert "in the part" not in clean.read_text()
