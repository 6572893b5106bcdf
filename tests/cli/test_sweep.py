"""`polish-sim sweep`: one folder, which resumes whatever ended the command."""

import json
import signal
import time
from pathlib import Path

import pytest

from polish_sim.cli.sweep import check_values
from polish_sim.errors import PolishSimError
from polish_sim.experiments import default_scenario
from polish_sim.studies.study import Axis, Study
from tests.cli.conftest import UNPROVEN, Started, done, metrics_of, refused
from tests.kept import plate_file

pytest.importorskip("pyarrow")
SHORT = ("--set", "process.max_feed_s=0.05", "--set", "process.feed_m_s=0.1")
HERE, ONE, OUT = ("--on", "here"), ("--workers", "1"), ("--out", "s")
MINE = """
class Mine:
    ranges = {"gain": (0.0, 1.0)}
    def __init__(self, gain=0.5):
        self.gain = gain
    def reset(self, cycle_s):
        print("hello")
    def step(self, measurement, target):
        return target.twist
"""


def rows_of(folder):
    lines = [json.loads(line) for line in (folder / "rows.jsonl").read_text().splitlines()]
    rows = {line["key"]: line["row"] | {"wall_s": 0.0, "loop_wall_s": 0.0} for line in lines}
    assert len(rows) == len(lines), "a row is there twice"
    return rows


def test_a_sweep_of_an_own_gain_is_one_folder_that_is_added_to(polish_sim):
    Path("mine.py").write_text(MINE)
    vary = ["sweep", "arc", "--controller", "mine.py:Mine", "--vary", "controller.own.gain=0:1:lin2", *OUT]
    assert "about" in done(polish_sim(*vary, *SHORT, *ONE, "--dry-run")).out
    assert not Path("s").exists()
    made = done(polish_sim(*vary, *SHORT, *ONE))
    files = {file.name for file in Path("s").iterdir()}
    assert {"runs.parquet", "study.toml", "metrics.json", "report.html"} <= files
    assert (metrics_of("s")["runs"], metrics_of("s")["failed"]) == (2, 0)
    before = rows_of(Path("s"))
    study = Path("s/study.toml")
    study.write_text(study.read_text().replace("seeds = 1", "seeds = 2"))
    done(polish_sim("sweep", "s", *HERE))
    after = rows_of(Path("s"))
    assert len(after) == 4
    assert {key: after[key] for key in before} == before
    with Path("s/rows.jsonl").open("ab") as rows:
        rows.write(b'{"key": "half')  # of a sweep that is at work
    begun = Path("s/rows.jsonl").read_bytes()
    done(polish_sim("sweep", "s", "--dry-run"))
    assert Path("s/rows.jsonl").read_bytes() == begun
    done(polish_sim("sweep", "s", *HERE))
    assert rows_of(Path("s")) == after
    assert "hello" not in made.out
    study.write_text(study.read_text().rstrip())  # as an editor may leave it
    done(polish_sim("sweep", "s", "--dry-run"))
    study.write_text(study.read_text().rpartition("\n")[0] + "\n")
    refused(polish_sim("sweep", "s", *HERE), "'s/study.toml' was cut", "# end")
    assert rows_of(Path("s")) == after


def test_a_sweep_along_a_plan_goes_on_by_its_file_and_does_damaged_runs_again(polish_sim):
    words = (plate_file(), "--up", "z", "--stepover", 40, "--pad-diameter", 80)
    done(polish_sim("plan", *words, *UNPROVEN, "--out", "plan"))
    # A force and a pad that are the usual ones count over the plan's.
    sets = ("process.max_feed_s=0.05", "process.contact_force_n=20", "pad.radius_m=0.025")
    words = ("--path", "plan", *(word for each in sets for word in ("--set", each)))
    done(polish_sim("sweep", "surface", *words, "--logs", *HERE, "--out", "s"))
    (run,) = Path("s/runs").iterdir()
    before, log = rows_of(Path("s")), (run / "log.npz").read_bytes()
    (run / "path.npz").unlink()
    assert "done again: " in done(polish_sim("sweep", "s", *HERE)).err
    assert (run / "log.npz").read_bytes() == log
    rows = [json.loads(line) for line in Path("s/rows.jsonl").read_text().splitlines()]
    assert {row["key"] for row in rows} == set(before)
    # A file that names its plan alone has the plan's settings.
    settings = 'plan.file = "plan"\nprocess.max_feed_s = 0.05'
    Path("mine.toml").write_text(f'experiment = "surface"\n[settings]\n{settings}')
    done(polish_sim("sweep", "mine.toml", *HERE, "--out", "mine"))
    assert '"plan.stepover_m" = 0.04' in Path("mine/study.toml").read_text()
    Path("idle.toml").write_text('experiment = "arc"\n[vary]\n"plan.stepover_m" = [0.01, 0.02]')
    refused(polish_sim("sweep", "idle.toml", "--dry-run"), "--vary plan.stepover_m", "run arc")


def test_a_killed_sweep_goes_on_to_the_same_rows(polish_sim, tmp_path):
    asked = ["sweep", "arc", "--vary", "sensor.force_noise_n=0.1:0.5:lin8", *SHORT]
    rows, begin, said = tmp_path / "s" / "rows.jsonl", [*asked, "--out", "s"], tmp_path / "err"
    for ended_by, least, where in ((signal.SIGKILL, 2, ONE), (signal.SIGINT, 4, HERE)):
        with said.open("ab") as err, Started(*begin, *where, folder=tmp_path, err=err.fileno()) as command:
            while not rows.exists() or rows.read_bytes().count(b"\n") < least:
                assert command.poll() is None
                time.sleep(0.02)
            command.send_signal(ended_by)
            assert command.wait(60) == (130 if ended_by == signal.SIGINT else -9)
    assert metrics_of(tmp_path / "s")["runs"] < 8
    for folder in "st":
        done(polish_sim(*asked, *HERE, "--out", folder))
    assert rows_of(tmp_path / "s") == rows_of(tmp_path / "t")
    assert len(rows_of(tmp_path / "s")) == 8
    assert "Warning" not in said.read_text()


def test_a_sweep_judges_values_together_and_says_why_no_run_was_done(polish_sim):
    force, limit = Axis("process.contact_force_n", "60", (60.0,)), Axis("safety.force_limit_n", "80", (80.0,))
    check_values(Study(default_scenario("force"), (force, limit)))
    with pytest.raises(PolishSimError):
        check_values(Study(default_scenario("force"), (force._replace(key="sensor.rate_hz", values=(5e3,)),)))
    Path("broken.stl").write_text("no mesh")
    code, out, err = polish_sim("sweep", "force", "--vary", "part.file=broken.stl", *HERE)
    assert code == 2
    assert "1 failed" in out
    assert "failed: broken.stl: " in err
