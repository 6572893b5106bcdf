"""Tables and words of a score whose rows are known beforehand."""

from dataclasses import replace

import pytest

from polish_sim import scoring
from polish_sim.analysis.claim import Claim
from polish_sim.scoring.figures import Asked
from polish_sim.scoring.plot import plot_score

A, B = scoring.Entry("alpha", "hybrid-pi"), scoring.Entry("beta", "position")
HOLD = scoring.Case("approach-20", "a hold", "force", ("process.hold_s=2",))
PATH = scoring.Case("freeform-60", "a path", "surface")


def row(case, entry, seed, **changed):
    settled = None if case.moving else 0.2
    whole = {
        "case": case.name, "controller": entry.label, "seed": seed, "settling_1n_s": settled,
        "overshoot_n": 0.5, "rms_error_n": 0.1, "p95_error_n": 0.2, "max_error_n": 0.4 + 0.1 * seed,
        "peak_force_n": 20.5, "contact_lost_s": 0.0, "stable": True, "mean_error_n": 0.0, "std_n": 0.1,
        "oscillation_n": 0.1, "peaks_error_n": None, "protective_stop": None, "duration": 5.0, "slowed": None,
    }  # fmt: skip
    return whole | changed


def score_of(*rows, entries=(A, B)):
    return scoring.Score((HOLD, PATH), entries, range(2), rows, len(rows))


LOST = {"contact_lost_s": 1.5, "oscillation_n": 25.0}
BROKEN = row(HOLD, B, 1, settling_1n_s=None, stable=False, max_error_n=30.0, **LOST)
BOTH = score_of(
    row(HOLD, A, 0), row(HOLD, A, 1), row(PATH, A, 0), row(PATH, A, 1),
    row(HOLD, B, 0), BROKEN, row(PATH, B, 0), row(PATH, B, 1),
)  # fmt: skip


def test_tables_and_page_say_each_case_never_where_settling_is_defined_and_the_worst():
    _, headings, rows, *_ = scoring.overview(scoring.summarize(BOTH), means=False)
    settling = headings.index("settling")
    assert [line[settling] for line in rows] == ["0.2", "never", "-", "-"]
    assert [line[0] for line in rows] == ["approach-20", "", "freeform-60", ""]
    assert [line[-1] for line in rows] == ["2/2", "1/2", "2/2", "2/2"]
    _, _, asked, *_ = scoring.verdict_table(B, scoring.judge(scoring.BATTERY_ASKED, BOTH.rows_of(B)))
    assert (asked[0][4], asked[0][-2:]) == ("never", ["approach-20, seed 1", "NO"])
    summaries = scoring.summarize(BOTH)
    worst = scoring.worst_case(summaries, B)
    assert (worst["case"], worst["seed"], worst["stable"]) == ("approach-20", 1, False)
    assert scoring.worst_case(summaries, A)["max_error_n"] == pytest.approx(0.5)
    assert scoring.breaking(summaries, A) == []
    (line,) = scoring.breaking(summaries, B)
    assert line.startswith("approach-20: 1 of 2 runs, contact lost for 0.75 s")
    stopped = row(HOLD, A, 0, stable=False, protective_stop="force above the limit", max_error_n=None)
    summaries = scoring.summarize(replace(BOTH, cases=(HOLD,), entries=(A,), rows=(stopped,)))
    assert scoring.breaking(summaries, A) == ["approach-20: 1 of 1 runs, force above the limit"]
    better = score_of(row(PATH, A, 0, max_error_n=1.0), row(PATH, B, 0, max_error_n=4.0))
    judged = scoring.judge(scoring.BATTERY_ASKED, better.rows_of(A))
    page = scoring.markdown(better, scoring.score_tables(better, [(A, judged)]))
    assert "## all cases, mean / worst seed" in page
    assert "| force | process.hold_s=2 |" in page
    assert "- worst case of beta: freeform-60 (seed 0, error up to 4 N)" in page
    assert "**stable**:" in page


def test_each_law_is_left_out_once_and_worth_how_much_a_figure_grows_without_it():
    own = ("controller.adaptive.crossover_rad_s=30",)
    entries = scoring.ablations(scoring.Entry("hybrid-adaptive", "hybrid-adaptive", own))
    scenarios = [HOLD.scenario(entry, 0) for entry in entries]
    laws = [set(scenario.controller.adaptive.laws.split()) for scenario in scenarios]
    whole = set().union(*laws)
    assert len(entries) == len(whole) >= 3
    assert [whole - left for left in laws] == [{entry.label.removeprefix("without ")} for entry in entries]
    assert {scenario.controller.adaptive.crossover_rad_s for scenario in scenarios} == {30.0}
    without = scoring.Entry("without feed", "hybrid-adaptive")
    grown = row(PATH, without, 0, max_error_n=2.4, stable=False)
    score = score_of(row(HOLD, A, 0), row(PATH, A, 0), row(HOLD, without, 0), grown, entries=(A, without))
    _, headings, (line,), *_ = scoring.ablation_table(score)
    cells = dict(zip(headings, line, strict=True))
    assert cells["law left out"] == "feed"
    assert cells["max [N]"] == "+1, +2 in freeform-60"
    assert cells["settling [s]"] == "+0, +0 in approach-20"
    assert cells["unstable runs"] == "+1"


def test_every_run_is_a_mark_of_its_controller_s_and_an_unstable_one_a_cross():
    asked = [Asked(Claim("max_error_n", "max", "N", high=1.0), "approach-20")]
    figure = plot_score(BOTH.rows, {"approach-20": False, "freeform-60": True}, asked)
    settling, _, largest, _ = figure.axes
    markers = [line.get_marker() for line in largest.lines]
    assert (markers.count("o"), markers.count("^")) == (4, 3)
    assert markers.count("x") == 1
    figure.draw_without_rendering()
    low, high = largest.get_xlim()
    ticks = largest.xaxis.majorTicks
    assert sum(bool(tick.label1.get_text()) and low <= tick.get_loc() <= high for tick in ticks) >= 3
    assert len(settling.lines) == 4  # not along the path
    assert [float(line.get_xdata()[0]) for line in largest.lines if line.get_marker() == "None"] == [1.0]
