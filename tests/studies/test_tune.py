"""Tuning finds what is there to be found, and says on unseen seeds whether it helps."""

import math
from dataclasses import replace

import pytest

from polish_sim.cli.tune import tuned_toml
from polish_sim.config import ControllerConfig
from polish_sim.errors import PolishSimError
from polish_sim.experiments.registry import default_scenario
from polish_sim.scenario_file import load_scenario
from polish_sim.scoring.figures import FIGURES
from polish_sim.scoring.score import Task
from polish_sim.studies import tune
from polish_sim.studies.tune import Goal, Search, judge_tuned, read_goal, read_over, search_best

pytest.importorskip("optuna")
BEST_P, BEST_I = 0.008, 0.02  #: Where the planted figure is least
MINE = """
class Mine:
    ranges = {"gain": (0.1, 10.0)}
    def __init__(self, gain=1.0, name="x", free=1.0): pass
    def reset(self, cycle_s): pass
    def step(self, measurement, target): pass
"""


class Planted:
    """Rows whose figure grows with the distance from known gains; unstable above a known one."""

    interrupted = False

    def __init__(self, lucky_seeds=False):
        self.asked: list[Task] = []
        self.lucky_seeds = lucky_seeds

    def fill(self, keys, *_, **_more):
        self.asked += keys
        return {task: self._row(task) for task in keys}

    def _row(self, task):
        gains = task.scenario.controller
        p, i = math.log(gains.force_p_m_sn / BEST_P), math.log(gains.force_i_m_s2n / BEST_I)
        seen = task.seed < tune.HELD_OUT_SEED
        error = 0.1 + p * p + i * i if seen or not self.lucky_seeds else 0.1 - p * p - i * i
        return {**dict.fromkeys((*FIGURES, "peaks_error_n", "slowed"), 0.0), "case": task.case.name,
                "rms_error_n": error, "stable": gains.force_p_m_sn < 0.012}  # fmt: skip


def search(**more):
    seen, held_out = tune.training_cases(["step-20", "flat-30"])
    over = read_over("hybrid-pi", ["force_p", "force_i"])
    goal, conditions = read_goal("worst:rms_error_n"), (tune.read_condition("stable"),)
    return replace(Search("hybrid-pi", over, goal, conditions, seen, held_out, 2), **more)


def over(text):
    return read_over("hybrid-pi", [text])


def silent(_number, _text):
    pass


@pytest.mark.parametrize("sampler", ["tpe", "cmaes"])
def test_the_search_finds_planted_gains_and_runs_paths_where_holds_are_good(sampler):
    scorer = Planted()
    best = search_best(search(sampler=sampler), 60, scorer, silent)
    assert best["controller.force_p_m_sn"] == pytest.approx(BEST_P, rel=0.3)
    assert best["controller.force_i_m_s2n"] == pytest.approx(BEST_I, rel=0.5)
    first = scorer.asked[0].scenario.controller
    assert (first.force_p_m_sn, first.force_i_m_s2n) == (0.004, 0.012)
    holds, paths = (sum(task.case.moving == moving for task in scorer.asked) for moving in (False, True))
    assert holds == 2 * 60
    assert 0 < paths < holds
    judged = judge_tuned(search(), best, 3, scorer)
    assert [verdict.better for verdict in judged] == [True, True, True]
    assert judged[2].rows == 3 * len(search().held_out)


def test_an_interrupted_search_makes_the_same_trials_again_and_gains_of_seen_seeds_alone_are_worse():
    begun, whole = Planted(), Planted()
    search_best(search(), 8, begun, silent)
    search_best(search(), 16, whole, silent)
    asked = [[(t.case.name, t.seed, t.entry.settings) for t in scorer.asked] for scorer in (begun, whole)]
    assert asked[1][: len(asked[0])] == asked[0]
    assert len(asked[1]) > len(asked[0])
    scorer = Planted(lucky_seeds=True)
    best = search_best(search(), 20, scorer, silent)
    seen, seeds, _ = judge_tuned(search(), best, 3, scorer)
    # on other seeds the planted figure falls with the distance
    assert (seen.better, seeds.better) == (True, False)


def test_a_condition_counts_more_than_any_goal():
    rows = [{"case": "step-20", "rms_error_n": 9.0, "stable": True, "settling_1n_s": None},
            {"case": "flat-30", "rms_error_n": 1.0, "stable": False, "settling_1n_s": None}]  # fmt: skip
    assert search().judge(rows) == tune.BROKEN * 1.5
    assert search(conditions=()).judge(rows) == 9.0
    assert search(conditions=(), goal=Goal("mean", "rms_error_n")).judge(rows) == 5.0
    assert search(conditions=(), goal=Goal("worst", "settling_1n_s")).judge(rows[1:]) != 0.0
    # a hold that never settles; a path has no such figure
    assert Goal("worst", "settling_1n_s").of(rows) == math.inf


def test_parameters_are_named_by_their_beginnings_and_have_ranges(tmp_path):
    p, i = read_over("hybrid-pi", ["force_p=0.001:0.02", "force_i"])
    assert (p.key, p.low, p.high, p.log) == ("controller.force_p_m_sn", 0.001, 0.02, True)
    shipped = ControllerConfig().force_i_m_s2n
    assert (i.low, i.high, i.shipped) == (shipped / 4, shipped * 4, shipped)
    (tmp_path / "mine.py").write_text(MINE)
    (gain,) = read_over(f"{tmp_path / 'mine.py'}:Mine", ["gain"])
    assert gain[:4] == ("controller.own.gain", 0.1, 10.0, 1.0)


@pytest.mark.parametrize(
    ("read", "texts", "said"),
    [
        (over, ["force", "forse_p", "name", "force_p=1:2", "force_p=a"], "tune|--over"),
        (read_goal, ["rms_error_n", "best:rms_error_n", "worst:rms", "worst:stable"], "goal"),
        (tune.read_condition, ["calm", "overshoot_n", "overshot_n<=3", "overshoot_n<=x"], "-to|condition"),
    ],
)
def test_a_parameter_goal_or_condition_that_is_none_is_refused(read, texts, said):
    for text in texts:
        with pytest.raises(PolishSimError, match=said):
            read(text)


def test_the_file_of_tuned_values_runs_them(tmp_path):
    (tmp_path / "tuned.toml").write_text(tuned_toml(search(), {"controller.force_p_m_sn": 0.005}))
    for name in ("force", "surface"):
        usual = default_scenario(name)
        run = load_scenario(tmp_path / "tuned.toml", usual)
        assert run == replace(usual, controller=replace(usual.controller, force_p_m_sn=0.005))
