"""A small job simulated: its times, a stop in the middle, and the same bytes again."""

import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from polish_sim.cell import Silent
from polish_sim.cli.boundary import execute
from polish_sim.cli.job import job_page
from polish_sim.cli.main import commands
from polish_sim.errors import InputError, PolishSimError
from polish_sim.job.job_file import read_job
from polish_sim.job.run_job import job_figures, programs, run_job
from polish_sim.log import read_removal
from polish_sim.row_file import locked
from tests.cli.conftest import Call, done, interrupted, refused
from tests.kept import plate_file

JOB = f"""
part = "{plate_file()}"
[cell]
safety.proof = "none"
[[setup]]
name = "on the table"
regions = ["box:0,0,-10,60,60,100"]
[[setup.pass]]
grit = 120
plan.pattern = "raster"
plan.stepover_m = 0.02
process.feed_m_s = 0.05
"""
FILE = "setup_1/region_1/pass_1/run/removal.npz"


class Stops(Silent):
    """Interrupts a pass some seconds after its start."""

    def __init__(self, after):
        self.after = after

    def progress(self, done, total):
        if total > 2.0 and done >= self.after:
            raise KeyboardInterrupt


def content(folder):
    return {file.relative_to(folder): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    file = tmp_path_factory.mktemp("job") / "job.toml"
    file.write_text(JOB)
    return read_job(file)


@pytest.fixture(scope="module")
def whole(job, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return folder, list(run_job(job, folder, Silent()))


def test_planned_and_simulated_time_agree_and_the_same_job_gives_the_same_bytes(job, whole, tmp_path):
    folder, rows = whole
    figures = job_figures(job, folder, rows)
    assert figures["planned_cycle_time_s"] == pytest.approx(figures["cycle_time_s"], rel=0.02)
    assert figures["contact_time_s"] + figures["air_time_s"] == pytest.approx(figures["cycle_time_s"])
    assert figures["operator_s"] == 90.0
    assert rows[0].figures["path_done"] == 1.0
    ((number, text),) = programs(job, folder)
    assert number == 1
    assert text.count("on the table") == 1
    assert "grit 120" in text
    shutil.copytree(whole[0], tmp_path, dirs_exist_ok=True)
    shutil.rmtree(tmp_path / "setup_1/region_1/pass_1")
    list(run_job(job, tmp_path, Silent()))

    assert content(tmp_path) == content(whole[0])


@pytest.mark.parametrize(("after", "pieces"), [(1.0, 1), (9.5, 2)])
def test_a_stopped_job_goes_on_and_takes_off_as_much(job, whole, tmp_path, after, pieces):
    """After 9.5 s less than a step-over is left: 1.5 of them are polished again, touch-down takes 0.5 s."""
    with pytest.raises(KeyboardInterrupt):
        list(run_job(job, tmp_path, Stops(after)))
    (row,) = run_job(job, tmp_path, Silent())
    assert row.figures["pieces"] == pieces
    assert not (tmp_path / "setup_1/region_1/pass_1/pieces").exists()
    alone = whole[1][0].figures
    assert row.figures["left_out"] == alone["left_out"]
    assert row.figures["bad_figures"] == alone["bad_figures"]
    one, two = (read_removal(folder / FILE) for folder in (whole[0], tmp_path))
    assert two.areas @ two.exposure == pytest.approx(one.areas @ one.exposure, rel=0.1)
    assert (two.exposure[one.exposure > 0.2 * one.mean] > 0.0).all()
    if after == 9.5:
        plan = json.loads((tmp_path / "setup_1/region_1/pass_1/plan/metrics.json").read_text())
        again = (1.5 * 0.02 + 0.5 * 0.05) / plan["path_length_m"]
        assert 1.0 < two.mean / one.mean < 1.0 + again


def test_a_job_says_what_its_passes_miss_and_polish_and_counts_an_area_once(job, whole, tmp_path):
    folder = shutil.copytree(whole[0], tmp_path / "out")
    file = folder / "setup_1/region_1/pass_1/run/metrics.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"tracking_error_max_m": 7.36e-4}))
    (row,) = run_job(job, folder, Silent())
    figures = job_figures(job, folder, [row, row])
    page = job_page("job", figures)
    (missed,) = figures["passes"][0]["bad_figures"]
    assert re.search(r"tangential.* 0\.736 mm.*<= 0\.65", missed)
    planned = json.loads((folder / "setup_1/region_1/pass_1/plan/metrics.json").read_text())
    noted = [f"{row.folder}, {row.folder}: {text}" for text in planned["notes"]]
    assert set(page.notes) > {f"bad: {row.folder}: {missed}.", *noted}
    assert page.title == "job: with bad figures"
    areas = [planned[f"{name}_area_m2"] for name in ("region", "polished", "left_out")]
    shown = page.tables["Passes"][1][1:4]
    assert list(map(float, shown)) == pytest.approx([1e4 * area for area in areas], abs=0.05)
    assert figures["polished_area_m2"] == areas[1]
    assert figures["polished_per_hour_m2"] == pytest.approx(3600.0 * areas[1] / figures["whole_s"])
    short = job_figures(job, folder, [row._replace(figures={**row.figures, "protective_stop": "slip"}), row])
    assert math.isnan(short["polished_per_hour_m2"])
    assert "no rate" in job_page("job", short).about
    labels = [label for label, _ in page.tables["Time"]]
    assert labels[labels.index("robot, simulated") + 1].strip() == "in contact"


def test_the_name_of_a_new_job_is_quoted_for_a_shell_and_its_part_for_toml(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    shutil.copy(plate_file(), 'blade "1".stl')
    assert execute(commands, ["job", "init", 'blade "1".stl']) == 0
    for line in (capfd.readouterr().out, Path('blade "1".toml').read_text().splitlines()[0]):
        assert line.strip().endswith("polish-sim job 'blade \"1\".toml'")
    assert read_job(Path('blade "1".toml')).head.parts == 1


def test_pieces_count_up_to_a_damaged_one_and_those_resumed_from_more_of_them_do_not(job, tmp_path):
    pieces = "setup_1/region_1/pass_1/pieces"

    def stopped(folder, after):
        with pytest.raises(KeyboardInterrupt):
            list(run_job(job, folder, Stops(after)))
        return sorted((folder / pieces).glob("0-*/*.npz"))

    def removal(folder):
        (row,) = run_job(job, folder, Silent())
        assert row.figures["pieces"] == 2
        return read_removal(folder / FILE).exposure

    last = stopped(tmp_path / "again", 8.0)[-1]
    shutil.copytree(tmp_path / "again", tmp_path / "short")
    (tmp_path / "short" / last.relative_to(tmp_path / "again")).unlink()
    wanted = removal(tmp_path / "short")
    stopped(tmp_path / "again", 1.0)
    assert len(list((tmp_path / "again" / pieces).iterdir())) == 2
    last.write_bytes(last.read_bytes()[:-9])
    np.testing.assert_array_equal(removal(tmp_path / "again"), wanted)


def test_a_pass_with_a_flange_is_left_to_its_own_programme(tmp_path):
    """URScript would press with the robot's force mode."""
    file = tmp_path / "job.toml"
    text = 'part = "plate"\n[[setup]]\n[[setup.pass]]\ntool = "active-flange"\n'
    file.write_text(text)
    job = read_job(file)
    ((_, programme),) = programs(job, tmp_path)
    assert job.passes[0].scenario.controller.name == "position"
    assert re.search("Mount active-flange.*the flange's own programme", programme, re.DOTALL)
    assert "force_mode" not in programme
    file.write_text(text + 'controller.name = "hybrid-pi"\n')
    with pytest.raises(PolishSimError, match="hybrid-pi"):
        read_job(file)


SPOILT = {
    "gone": ["plan/path.script", "plan/pass.json", "run/log.npz", "run/metrics.json", "run/removal.npz"],
    "null": ["plan/path.script", "plan/pass.json", "run/config.toml"],
    "cut": ["plan/path.script", "run/config.toml"],
    "damaged": ["run/log.npz", "run/path.npz", "run/removal.npz"],
    "cycle_time_s": ["run/metrics.json"],  # the figure that is missing
}


@pytest.mark.parametrize("how", SPOILT)
def test_a_pass_that_is_no_longer_whole_is_named(job, whole, tmp_path, how):
    for number, name in enumerate(SPOILT[how]):
        folder = shutil.copytree(whole[0], tmp_path / str(number))
        here = folder / "setup_1/region_1/pass_1"
        content = (here / name).read_bytes()
        middle, figures = len(content) // 2, json.loads((here / "run/metrics.json").read_text())
        spoilt = {
            "null": b'{"pose": null}',
            "cut": content.rpartition(b"#")[0],
            "damaged": content[:middle] + bytes(40) + content[middle + 40 :],
            "cycle_time_s": json.dumps({k: figures[k] for k in figures.keys() - {how}}).encode(),
        }
        if name == "plan/pass.json":
            shutil.rmtree(here / "run")
        (here / name).unlink()
        if how in spoilt:
            (here / name).write_bytes(spoilt[how])
        told = {"gone": name.removeprefix("run/"), "cycle_time_s": how}.get(how, name)
        with pytest.raises(InputError, match=f"delete '.*pass_1', and --resume .*{told}"):
            _ = [*run_job(job, folder, Silent()), *programs(job, folder)]


def test_another_job_in_a_folder_does_its_own_passes_a_changed_part_ends_it(tmp_path, capfd, monkeypatch):
    part, file, out = tmp_path / "part.stl", tmp_path / "job.toml", tmp_path / "out"
    text = JOB.replace(str(plate_file()), str(part)).replace("0.02", "0.04")

    def job(*words):
        capfd.readouterr()
        code = execute(commands, ["job", str(file), "--out", str(out), *words])
        return Call(code, *capfd.readouterr())

    def seconds():
        return float(json.loads((out / "job.json").read_text())["contact_time_s"])

    shutil.copy(plate_file(), part)
    file.write_text(text)
    refused(job("--resume"), str(out), "leave --resume out")
    assert not out.exists()
    said = done(job())
    assert "with bad figures" in " ".join(said.out.split())
    assert re.search("bad: setup_1/region_1/pass_1: .* are left out", said.err)
    assert not (out / ".lock").exists()
    first = seconds()
    refused(job())
    refused(job("--resume", "--overwrite"), "--overwrite does it anew: give one")
    piece = out / "setup_1/region_1/pass_1/pieces/0-1/000001.npz"
    (piece.parents[2] / "run").rename(tmp_path / "run")
    piece.parent.mkdir(parents=True)
    piece.touch()
    refused(job("--resume", "--check"), "0 of 1 passes done, and 1 s of the next", code=1)
    with locked(out / ".lock", "job"):
        for word in ("--resume", "--overwrite"):
            refused(job(word), "another job is at work")
    (out / "job.toml").unlink()
    (out / "setup_notes").mkdir()
    file.write_text(text.replace("0.05", "0.1"))
    done(job("--overwrite"))
    assert seconds() < 0.8 * first
    assert (out / "setup_notes").is_dir()
    # A job that cannot be planned or is interrupted leaves the one that was there, one that is killed no job.
    kept = content(out)
    file.write_text(text.replace("[cell]", "[cell]\npart.pose = [5.0, 0.0, 0.1, 0.0, 0.0, 0.0]"))
    refused(job("--overwrite"))
    assert content(out) == kept
    file.write_text(text)
    with monkeypatch.context() as patch:
        patch.setattr("polish_sim.job.run_job._play", interrupted)
        refused(job("--overwrite"), "stays", code=130)
        assert content(out) == kept
        patch.undo()
        patch.setattr("polish_sim.cli.job.put_file", interrupted)
        refused(job("--overwrite"), code=130)
    assert not {"job.toml", "job.json"} & {file.name for file in out.iterdir()}
    done(job("--overwrite"))
    assert seconds() == first
    trimesh.creation.box((202.0, 200.0, 20.0)).apply_translation([0.0, 0.0, 10.0]).export(part)
    refused(job("--resume"), "made on another file", "Do the job anew with --overwrite")
