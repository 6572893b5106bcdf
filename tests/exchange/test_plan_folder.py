"""Plan folders, old ones too, and other programs' CSVs: written, read back, refused with the place."""

import json
import shutil
from dataclasses import fields
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from polish_sim.errors import ConfigError, InputError, PolishSimError
from polish_sim.exchange import ExportSetup, export_plan, read_path, write_plan
from polish_sim.experiments import default_scenario
from polish_sim.log import read_log
from polish_sim.planning.toolpath import PROCESS
from polish_sim.scenario_file import load_scenario, override, to_toml
from tests.cli.conftest import done, polish_sim
from tests.exchange.test_cam_files import PROGRAM
from tests.planning.shapes import shipped_plan, with_wishes

__all__ = ["polish_sim"]


@pytest.fixture
def folder(tmp_path):
    write_plan(tmp_path / "plan", sphere())
    return tmp_path / "plan"


def read_text(folder, name, text):
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_path(folder / name)


@pytest.mark.parametrize("name", ["", "path.json", "path.csv"])
@pytest.mark.parametrize("wishes", [False, True])
def test_a_written_path_reads_back_bit_for_bit(tmp_path, name, wishes):
    plan = with_wishes(sphere()) if wishes else sphere()
    write_plan(tmp_path, plan)
    back = read_path(tmp_path / name)
    for field in fields(back):
        wanted, found = getattr(plan.path, field.name), getattr(back, field.name)
        assert (wanted is None) == (found is None)
        if wanted is not None:
            assert found.dtype == wanted.dtype
            # The arc length is summed anew, axes are brought to length one anew.
            most = 1e-12 if field.name in ("s", "axes_work") else 1e-300
            assert np.abs(found - wanted).max() < most, field.name
    assert ("force" in (tmp_path / "path.csv").read_text().splitlines()[0]) == wishes


def test_a_plain_path_in_millimetres_is_read_with_force_and_feed_from_any_editor(tmp_path):
    """With a byte-order mark, blank lines, comments, capitals and blanks."""
    text = "# made elsewhere\r\n\r\nX, Y, Z, I, J, K, Force, Feed\r\n0,0,20,0,0,1,12,10\r\n\r\n# half way\r\n"
    text += "10,0,20,0,0,1,15,20\r\n10, 5,20,0,0.6,0.8,15,20\r\n"
    path = read_text(tmp_path, "plain.csv", b"\xef\xbb\xbf" + text.encode())
    assert path.positions_work[2] == pytest.approx([0.01, 0.005, 0.02])
    assert path.axes_work[2] == pytest.approx([0.0, 0.6, 0.8])
    assert path.s == pytest.approx([0.0, 0.01, 0.015])
    assert (path.segment == PROCESS).all()
    assert path.force == pytest.approx([12.0, 15.0, 15.0])
    assert path.feed == pytest.approx([0.01, 0.02, 0.02])


sphere = partial(shipped_plan, "sphere_100")
HEADER = "x,y,z,i,j,k\n"
FIRST = HEADER + "0,0,0,0,0,1\n"
WISHES = "x,y,z,i,j,k,force,feed\n0,0,20,0,0,1,12,10\n"
OWN = "s_m,x_m,y_m,z_m,nx,ny,nz,pass_index,segment\n0,0,0,0,0,0,1,0,process\n"
BAD = {
    "only a header": (HEADER, "holds no points"),
    "wrong columns": ("a,b\n1,2\n", "columns a, b"),
    "a column twice": ("x,y,z,i,j,k,x\n0,0,20,0,0,1,3\n", "line 1: the header names x more than once"),
    "a short row": (FIRST + "1,2\n", "line 3: 2 values"),
    "lines as an editor counts them": (f"#\n\n{FIRST}\n1,0,oops,0,0,1\n", "line 6, point 2: z is 'oops'"),
    "beyond what is measured": (FIRST + "1,0,-1e300,0,0,1\n", "point 2: z is '-1e300', beyond 1e\\+12"),
    "a huge field": (HEADER + '"' + 200_000 * "1" + '",0,0,0,0,1\n', "not CSV"),
    "an axis too long": (FIRST + "1,0,0,0,0,2\n", "point 2: the tool axis"),
    "a repeated point": (FIRST + "0,0,0,0,0,1\n", "points 1 and 2 are the same"),
    "one point": (FIRST, "one point"),
    "metres for millimetres": (FIRST + "1e6,0,20,0,0,1\n", "line 3, point 2: a coordinate beyond"),
    "no force": (WISHES + "1,0,20,0,0,1,0,10\n", "line 3, point 2: force is 0"),
    "standing still": (WISHES + "1,0,20,0,0,1,5,0\n", "line 3, point 2: feed is 0"),
    "a part of a pass": (OWN + "1,1,0,0,0,0,1,0.5,process\n", "line 3, point 2: pass_index is '0.5'"),
    "an unknown segment": (OWN + "1,1,0,0,0,0,1,0,jump\n", "line 3, point 2: unknown segment 'jump'"),
    "a zero byte behind a segment": (OWN + "1,1,0,0,0,0,1,0,process\0\n", "line 3, point 2: unknown segment"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_named_with_the_place(tmp_path, case):
    text, message = BAD[case]
    with pytest.raises(InputError, match=message) as caught:
        read_text(tmp_path, "bad.csv", text)
    assert "bad.csv" in str(caught.value)


def test_a_folder_holds_what_the_contract_names_and_bad_files_and_sources_of_it_are_named(folder):
    assert sorted(file.name for file in folder.iterdir()) == ["metrics.json", "path.csv", "path.json"]
    header = (folder / "path.csv").read_text().splitlines()[0].split(",")
    assert header[:9] == ["s_m", "x_m", "y_m", "z_m", "nx", "ny", "nz", "pass_index", "segment"]
    wanted = (
        "facets fit_rms_m path_length_m cycle_time_s stepover_mean_m stepover_p5_m stepover_p95_m coverage "
        "coverage_stepover self_crossings retracts max_distance_to_surface_m plan_time_s stepover_excluded"
    )
    assert set(wanted.split()) <= set(json.loads((folder / "metrics.json").read_text()))
    document = json.loads((folder / "path.json").read_text())
    assert document["part"]["sha256"] == sphere().mesh.sha256
    assert (document["part"]["unit"], document["up"]) == ("mm", [0.0, 0.0, 1.0])
    assert (document["pattern"], document["stepover_m"]) == ("spiral", 0.008)
    document = json.loads((folder / "path.json").read_text())
    document["path"]["nx"].pop()
    for name, text, message in (
        ("bad.json", "{", "not JSON"), ("bad.json", "[1, 2]", "holds no path"),
        ("bad.json", json.dumps(document), "unequal length"), ("part.stl", "solid", r"\.apt.*\.csv"),
        ("picture.csv", b"\x89PNG\xff\xfe\x00", "not a text file"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=message):
            read_text(folder, name, text)
    for source, message in ((folder / "nothing.csv", "cannot read"), (folder.parent, "not a plan folder")):
        with pytest.raises(InputError, match=message):
            read_path(source)
    with pytest.raises(NotADirectoryError):
        write_plan(folder / "part.stl" / "plan", sphere())
    lines = (folder / "path.csv").read_text().splitlines(keepends=True)
    whole = len(read_path(folder).s)
    (folder / "path.csv").write_text("".join(lines[:-20]))
    with pytest.raises(InputError, match=r"path\.csv' is not the path of path\.json"):
        read_path(folder)
    assert len(read_path(folder / "path.csv").s) == whole - 20


@pytest.mark.parametrize("suffix", [".csv", ".json", ".apt", ".nc"])
def test_a_damaged_file_is_a_path_or_one_message(tmp_path, suffix):
    """150 files with bytes changed, cut, doubled: never a traceback."""
    rng = np.random.default_rng(7)
    export_plan(tmp_path, sphere(), ["csv", "json", "apt"], ExportSetup())
    whole = PROGRAM.encode() if suffix == ".nc" else (tmp_path / f"path{suffix}").read_bytes()
    if suffix == ".json":
        columns = json.loads(whole)["path"].items()
        whole = json.dumps({"path": {name: column[:8] for name, column in columns}}).encode()
    elif suffix != ".nc":
        lines = whole.splitlines()
        whole = b"\n".join([*lines[:12], *lines[-3:]])
    messages = []
    for _ in range(150):
        content = bytearray(whole)
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(0, len(content)))
            noise = rng.integers(0, 256, int(rng.integers(0, 6)), np.uint8).tobytes()
            content[at : at + int(rng.integers(0, 9))] = noise
        try:
            read_text(tmp_path, f"damaged{suffix}", bytes(content))
        except PolishSimError as error:
            messages.append(str(error))
    assert len(messages) > 20
    assert all(f"damaged{suffix}" in message for message in messages)


OLD = Path(__file__).resolve().parent.parent / "files_of_8ef5763"  #: Of before the packages moved


def test_an_older_config_gives_the_same_settings_when_written_again(tmp_path):
    for name, experiment in (("config_surface", "surface"), ("config_dual", "dual"), ("run/config", "force")):
        defaults = default_scenario(experiment)
        scenario = load_scenario(OLD / f"{name}.toml", defaults)
        assert scenario.robot.arm == "ideal"
        (tmp_path / "again.toml").write_text(to_toml(scenario), encoding="utf-8")
        assert load_scenario(tmp_path / "again.toml", defaults) == scenario
    gone = tmp_path / "gone.toml"
    gone.write_text('[dual]\nmaster_arc_radius_m = 0.0\nmaster_axis = "auto"\n', encoding="utf-8")
    assert load_scenario(gone, defaults) == defaults
    for section, line, cure in (
        ("dual", "master_arc_radius_m = 0.1", "dual.master_path"),
        ("drag", "tolerance_m = 0.0005", "drag.fit_rms_m"),
    ):
        gone.write_text(f"[{section}]\n{line}\n", encoding="utf-8")
        with pytest.raises(ConfigError, match=cure):
            load_scenario(gone, defaults)
        with pytest.raises(ConfigError, match=cure):
            override(defaults, [f"{section}.{line}"])


@pytest.mark.pictures
def test_an_older_plan_run_and_calibrations_are_read_and_drawn_again(polish_sim):
    table, document = read_path(OLD / "plan" / "path.csv"), read_path(OLD / "plan" / "path.json")
    assert len(table.s) == len(document.s) > 100
    assert abs(table.positions_work - document.positions_work).max() < 1e-9
    folder = Path("run")
    shutil.copytree(OLD / "run", folder)
    assert len(read_log(folder / "log.npz")) > 10
    done(polish_sim("report", folder, "--out", "report"))
    assert Path("report/force.png").stat().st_size > 10_000
    for experiment, names in (("force", ["payload"]), ("dual", ["tcp", "base"]), ("dual", ["arm"])):
        calibrations = [word for name in names for word in ("--calibration", OLD / f"{name}.toml")]
        done(polish_sim("run", experiment, *calibrations, "--set", "robot.arm=ideal", "--dry-run"))
