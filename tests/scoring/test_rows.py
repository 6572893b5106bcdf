"""Rows of the score: measured, kept, found again; its cases, and bounds no controller can beat."""

import json
import math
import runpy
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import polish_sim
from benchmarks.force_theory import drift_bound, step_bound, tracking_bound
from polish_sim import cli, models, scoring
from polish_sim.errors import InputError
from polish_sim.experiments import default_scenario
from polish_sim.row_file import ROWS, Rows, locked
from polish_sim.scenario_file import override
from polish_sim.scoring import Entry, Task, choose_cases, measure_row, run_score, user_entry
from polish_sim.scoring.battery import BATTERY, Case, Draw, latency_settings
from polish_sim.scoring.border import judge_rest
from polish_sim.scoring.loop_model import share_latency
from polish_sim.scoring.score import keys_of, setup_key
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
FORCE = default_scenario("force")


def scored(folder, workers=1):
    """Two cases with two seeds, and how many rows there were whenever one was measured."""
    seeds, measured = 2, list[int]()
    with locked(folder / "rows.jsonl"), open_workers("here" if workers == 1 else "local", workers) as crew:
        runner = Runner(Rows(folder), crew, lambda done, *_: measured.append(done))
        score = run_score((SHORT, OTHER), [PI], range(seeds), runner)
    return score, measured


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
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

    def source():
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


def test_every_case_is_a_scenario_chosen_by_name_or_pattern_that_shares_its_set_up_where_it_may():
    for cases, asked in ((scoring.BATTERY, scoring.BATTERY_ASKED), (scoring.REACH_CASES, scoring.REACH)):
        names = [case.name for case in cases]
        assert len(set(names)) == len(names)
        for case in cases:
            scenario = case.scenario(PI, 3)
            assert (scenario.seed, scenario.controller.name) == (3, "hybrid-pi")
            assert scenario.experiment == case.experiment
            assert case.text
        assert all(any(one.applies(name) for name in names) for one in asked)
    names = [case.name for case in scoring.choose_cases(scoring.BATTERY, ["step-20", "latency-*", "step-10"])]
    assert names == ["step-10", "step-20", "latency-2", "latency-4", "latency-12", "latency-20"]
    assert scoring.choose_cases(scoring.BATTERY, []) == scoring.BATTERY
    slow, fast = scoring.choose_cases(scoring.BATTERY, ["freeform-10", "freeform-30"])
    off = scoring.choose_cases(scoring.BATTERY, ["part-3mm"])[0]
    assert setup_key(Task(slow, PI, 1)) == setup_key(Task(fast, PI, 1))
    assert setup_key(Task(slow, PI, 1)) != setup_key(Task(slow, PI, 2))
    assert setup_key(Task(slow, PI, 1)) != setup_key(Task(off, PI, 1))
    soft = scoring.choose_cases(scoring.BATTERY, ["stiffness-0.2"])[0]
    drawn = replace(soft, settings=(*soft.settings, "head.spring_scale=1.0"))
    assert setup_key(Task(soft, PI, 1)) != setup_key(Task(drawn, PI, 1))


def test_latency_is_shared_one_to_three_and_a_draw_depends_on_the_seed_alone():
    for total_ms, shares in ((20, (0.005, 0.015)), (1, (0.001, 0.0))):
        scenario = scoring.Case("x", "x", "force", latency_settings(total_ms)).scenario(PI, 0)
        assert (scenario.sensor.latency_s, scenario.robot.command_latency_s) == pytest.approx(shares)
    assert share_latency(0.008) == pytest.approx((FORCE.sensor.latency_s, FORCE.robot.command_latency_s))
    case = scoring.Case("x", "x", "surface", draws=(Draw("process.feed_m_s", 0.01, 0.06),))
    feeds = [case.scenario(PI, seed).process.feed_m_s for seed in range(20)]
    assert feeds == [case.scenario(PI, seed).process.feed_m_s for seed in range(20)]
    assert len(set(feeds)) == 20
    assert 0.01 <= min(feeds) < 0.02 < 0.05 < max(feeds) <= 0.06


def test_the_worst_seed_decides_and_an_undefined_figure_never_passes():
    good = {"overshoot_n": 0.1, "std_n": 0.1, "max_error_n": 0.2, "peak_force_n": 21.0, "stable": True}
    row = {"case": "approach-20", "controller": "x", **good}
    rows = [{**row, "seed": seed, "settling_1n_s": 0.1 + 0.1 * seed} for seed in range(3)]
    settling = scoring.judge(scoring.BATTERY_ASKED, rows)[0]
    assert settling.worst == pytest.approx(0.3)
    assert (settling.met, settling.worst_case) == (False, "approach-20, seed 2")
    assert settling.mean == pytest.approx(0.2)
    rows[1]["settling_1n_s"] = None
    settling = scoring.judge(scoring.BATTERY_ASKED, rows)[0]
    assert (settling.worst, settling.met, settling.worst_case) == (None, False, "approach-20, seed 1")
    assert all(verdict.met for verdict in scoring.judge(scoring.BATTERY_ASKED, rows)[1:])


def test_without_noise_and_latency_the_step_is_the_time_optimal_move_and_drift_ends_as_a_kalman_filter():
    delays = [f"{name}_s=0" for name in ("sensor.latency", "robot.command_latency")]
    perfect = override(FORCE, ["sensor.force_noise_n=0", "sensor.rate_hz=10000", *delays])
    bound = step_bound(perfect, 1e-9, band=1e-9)
    # half speeding up, half braking
    assert bound.settling == pytest.approx(2.0 * math.sqrt(0.004 / 1.2), rel=0.01)
    detection = step_bound(FORCE, 0.02).detection  # of the ramp, at the stated separation
    ramp = 5000.0 * 0.02 * 0.001 * np.arange(1, round(1e3 * detection) + 1)
    assert math.sqrt(np.sum(ramp**2)) / 0.5 == pytest.approx(4.5, rel=0.15)
    walk, noise, variance = 0.002**2 * 0.001, 0.5**2, 1.0
    for _ in range(200_000):
        variance = 1.0 / (1.0 / (variance + walk) + 1.0 / noise)
    assert drift_bound(FORCE) == pytest.approx(math.sqrt(variance), rel=0.01)


def test_a_filter_tuned_by_hand_does_not_beat_the_bound():
    feed, h, rng, waves = 0.03, 0.005, np.random.default_rng(0), (0.04, 0.15)
    known = override(FORCE, ["part.displacement_m=0", "part.rotation_rad=0"])
    bound, errors = tracking_bound(known, feed, waves), []
    for _ in range(40):
        t = np.arange(2400) * h
        numbers = 2.0 * math.pi / rng.uniform(*waves, 8) * rng.uniform(-1.0, 1.0, 8)
        phases = rng.uniform(0.0, 2.0 * math.pi, 8)
        height = np.sin(feed * t[:, None] * numbers + phases).sum(axis=1) / 2.0 * (0.0003 / 4.5)
        reading = 5000.0 * height + rng.normal(0.0, 0.5 * math.sqrt(0.001 / h), len(t))
        place, rate = 0.0, 0.0
        for k in range(len(t) - 2):
            miss = reading[k] - place
            place, rate = place + h * rate + 0.06 * miss, rate + 0.3 * miss * h
            if k > 1200:
                errors.append(5000.0 * height[k + 2] - place - 2 * h * rate)
    assert bound < float(np.std(errors)) < 4.0 * bound


def test_a_dying_swing_is_rest_and_a_lasting_one_is_not():
    t = np.arange(0.0, 4.0, 0.001)
    sizes = 5.0 * np.exp(-t), 5.0, 0.5
    dying, lasting, small = (judge_rest(20.0 + a * np.sin(30.0 * t), 20.0, 0.001) for a in sizes)
    assert dying.resting
    assert not lasting.stable
    assert (small.stable, small.resting) == (True, False)
    assert lasting.frequency == pytest.approx(30.0, rel=0.04)
