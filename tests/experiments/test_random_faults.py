"""Random faults in random runs, a few; `python -m benchmarks.faults --count 200` does the many."""

import pytest

from benchmarks.faults import DRAWN, RUNS, draw, inject
from polish_sim.cell import FAULTS


@pytest.mark.parametrize("injection", draw(200, seed=3)[:4], ids=lambda one: f"{one.fault}-{one.experiment}")
def test_no_fault_leads_to_60_newton_or_loses_the_log_or_leaves_the_tool_on_the_part(injection):
    assert inject(injection).wrong == ()


def test_every_fault_is_drawn_about_as_often():
    drawn = draw(200)
    assert set(DRAWN) == set(FAULTS)
    for name in DRAWN:
        assert abs(sum(one.fault == name for one in drawn) - 200 / len(DRAWN)) <= 1
    assert {one.experiment for one in drawn} == set(RUNS)
    assert draw(200) == drawn
