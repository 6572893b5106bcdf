"""Rows: measured in the simulator, kept on disk, found again."""

import json
import runpy
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import polish_sim
from polish_sim import cli, models
from polish_sim.errors import InputError
from polish_sim.row_file import ROWS, Rows, locked
from polish_sim.scoring import Entry, Score, Task, choose_cases, measure_row, run_score, user_entry
from polish_sim.scoring.battery import BATTERY, Case
from polish_sim.scoring.score import keys_of
from polish_sim.workers import Runner, open_workers
from tests.kept import plate_file

PI = Entry("hybrid-pi", "hybrid-pi")
HOLD = (f"part.file={plate_file()}", "process.hold_s=1.5")
SHORT = Case("short", "a short hold", "force", HOLD)
OTHER = Case("other", "a short hold of 10 N", "force", (*HOLD, "process.contact_force_n=10"))
CONTROLLER = """
class Press:
    def reset(self, cycle_s):
        pass

    def step(self, measurement, target):
        {body}
"""


def scored(folder: Path, workers: int = 1) -> tuple[Score, list[int]]:
    """Two cases with two seeds, and how many rows there were whenever one was measured."""
    seeds, measured = 2, list[int]()
    with locked(folder / "rows.jsonl"), open_workers("here" if workers == 1 else "local", workers) as crew:
        runner = Runner(Rows(folder), crew, lambda done, *_: measured.append(done))
        score = run_score((SHORT, OTHER), [PI], range(seeds), runner)
    return score, measured


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Score, bytes]:
    """A score measured by one process, and the file of its rows."""
    folder = tmp_path_factory.mktemp("whole")
    return scored(folder)[0], (folder / ROWS).read_bytes()


def test_what_ran_before_in_the_process_does_not_show_in_a_row_but_its_seed_does():
    (moving,) = choose_cases(BATTERY, ["moving-1hz"])
    moving = replace(moving, settings=("part.motion_m=0.0005", "process.hold_s=1.5"))
    alone = measure_row(Task(SHORT, PI, 0))
    measure_row(Task(moving, PI, 0))
    measure_row(Task(OTHER, PI, 0))
    assert measure_row(Task(SHORT, PI, 0)) == alone
    assert measure_row(Task(SHORT, PI, 1)) != alone


def test_rows_are_the_same_whatever_the_number_of_processes(whole, tmp_path):
    assert scored(tmp_path, workers=2)[0].rows == whole[0].rows
    order = [(row["case"], row["seed"]) for row in whole[0].rows]
    assert order == [("short", 0), ("short", 1), ("other", 0), ("other", 1)]


@pytest.mark.parametrize(
    ("left", "counted"),
    [
        (lambda lines: [b'not json\n{"key": 3}\n', *lines[:3], lines[3][:40]], [3, 4]),
        (lambda lines: [line for line in lines if json.loads(line)["row"]["seed"] == 0], [2, 3, 4]),
    ],
    ids=["damaged and torn lines", "more seeds"],
)
def test_a_score_goes_on_where_it_was_and_measures_only_what_is_missing(whole, tmp_path, left, counted):
    (tmp_path / ROWS).write_bytes(b"".join(left(whole[1].splitlines(keepends=True))))
    refused = pytest.raises(InputError, match="another score is at work")
    with locked(tmp_path / "rows.jsonl"), refused:
        scored(tmp_path)
    again, measured = scored(tmp_path)
    assert measured == counted
    assert again.rows == whole[0].rows
    assert scored(tmp_path)[1] == [4]


def test_a_row_counts_only_for_the_scenario_and_the_source_it_was_measured_with(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(CONTROLLER.format(body="return target.twist"))
    task = Task(SHORT, user_entry(f"{file}:Press"), 0)
    others = [task._replace(seed=1), task._replace(case=replace(SHORT, settings=("process.hold_s=2",)))]
    key = keys_of([task])[task]
    assert keys_of([task]) == {task: key}
    assert len(set(keys_of([task, *others]).values())) == 3
    file.write_text(CONTROLLER.format(body="return 0 * target.twist"))
    assert keys_of([task])[task] != key
    copy = tmp_path / "polish_sim"
    for target, package in ((copy, polish_sim), (copy / "cli", cli), (copy / "models", models)):
        folder = Path(package.__file__).parent
        shutil.copytree(folder, target, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)

    def source() -> str:
        names = runpy.run_path(str(copy / "source_stamp.py"), run_name="polish_sim.source_stamp")
        return names["package_hash"]()

    made_by = ("scoring/score.py", "studies/table.py", "models/ur5e_spindle.xml", "cli/run.py", "cli/many.py")
    for file, counts in [*((name, True) for name in made_by), ("page/page.py", False), ("workers.py", False)]:
        before = source()
        with (copy / file).open("a") as edited:
            edited.write("\n")
        assert (source() != before) == counts, file


def test_a_failing_controller_and_a_case_out_of_reach_are_stops_and_half_the_feed_is_slow(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(CONTROLLER.format(body="raise ValueError('lost my gains')"))
    far = Case("far", "out of reach", "force", ("part.pose=[3.0, 0.0, 0.0, 0.0, 0.0, 0.0]",))
    for task, said in (
        (Task(SHORT, user_entry(f"{file}:Press"), 0), "lost my gains"),
        (Task(far, PI, 0), "not run: the part cannot stand"),
    ):
        row = measure_row(task)
        assert said in row["protective_stop"]
        assert (row["stable"], row["settling_1n_s"], row["max_error_n"]) == (False, None, None)
    file.write_text("import numpy as np\n" + CONTROLLER.format(body="return np.append(target.twist, 0.5)"))
    (flat,) = choose_cases(BATTERY, ["flat-30"])
    line = replace(flat, settings=(*flat.settings, f"part.file={plate_file()}", "process.max_feed_s=2"))
    assert 0.5 < measure_row(Task(line, user_entry(f"{file}:Press"), 0))["slowed"] < 0.6  # and the ramp
