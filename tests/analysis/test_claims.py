"""What is asked of a run, and when it counts as met."""

import math

import numpy as np
import pytest

from polish_sim.analysis.claim import Claim, bound_text, shortfalls, value_text
from polish_sim.analysis.metrics import measure_arc, measure_force, measure_removal, measure_surface
from polish_sim.dual.experiment import CALIBRATIONS
from polish_sim.experiments.registry import claims_shown, default_scenario, experiment, experiments
from polish_sim.experiments.rows import PAYLOAD_CLAIMS
from polish_sim.identification.settings import IDENTIFY
from polish_sim.scenario_file import merge, override
from tests.analysis.synthetic import arc_trace, bumpy_path, force_trace, removal_map, surface_trace


def asked_of(name: str) -> tuple[Claim, ...]:
    row = experiment(name)
    return row.claims(row.defaults)


def test_every_claim_names_a_figure_that_is_measured():
    path = bumpy_path()
    measured = {
        "arc": measure_arc(arc_trace()),
        "force": measure_force(force_trace(), 20.0),
        "surface": measure_surface(surface_trace(path), path, 20.0)
        | measure_removal(removal_map(np.ones(5))),
    }
    for name, figures in measured.items():
        assert {claim.figure for claim in asked_of(name)} <= {*figures, "path_done", "cycle_time_s"}


def test_a_good_arc_meets_all_claims_and_a_wide_one_misses_the_tracking_error():
    ideal = experiment("arc").claims(override(default_scenario("arc"), ["robot.arm=ideal"]))
    good = measure_arc(arc_trace(radial_error_m=5e-5)) | {"path_done": 1.0}
    wide = measure_arc(arc_trace(radial_error_m=2e-4)) | {"path_done": 1.0}
    assert shortfalls(ideal, good) == []
    assert [claim.figure for claim in shortfalls(ideal, wide)] == ["tracking_error_max_m"]
    usual = experiment("arc").claims(default_scenario("arc"))
    assert shortfalls(usual, wide) == []
    assert [claim.figure for claim in shortfalls(usual, wide | {"path_done": 0.5})] == ["path_done"]


def test_an_undefined_figure_meets_no_bound_and_the_worst_of_several_seeds_is_the_least_good():
    assert not Claim("x", "x", "N", high=1.0).met_by(math.nan)
    assert Claim("x", "x", "N").met_by(math.nan)
    claim = Claim("x", "x", "mm", low=5e-5, high=1e-4)
    assert (bound_text(claim), value_text(claim, math.nan)) == ("0.05 to 0.1", "-")
    assert Claim("x", "x", "%", more_is_better=True).worst_of([0.9, 0.7, 0.8]) == 0.7
    assert Claim("x", "x", "N", high=0.5).worst_of([0.1, 0.4, 0.2]) == 0.4
    assert math.isnan(Claim("x", "x", "N", high=0.5).worst_of([0.1, math.nan]))
    assert math.isnan(Claim("x", "x", "N", high=0.5).worst_of([]))


def test_a_lower_bound_goes_with_more_being_better():
    tables = [*map(asked_of, experiments()), *CALIBRATIONS.values(), *IDENTIFY.values(), PAYLOAD_CLAIMS]
    for claim in (claim for claims in tables for claim in claims):
        assert claim.more_is_better or math.isinf(claim.low)


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("arc", {"process": {"feed_m_s": 0.02}}),
        ("force", {"part": {"file": "freeform"}}),
        ("surface", {"process": {"contact_force_n": 12.0}}),
        ("surface", {"plan": {"file": "mine.csv"}}),
        ("smooth", {"plan": {"file": "mine.csv"}}),
    ],
)
def test_the_paper_s_figures_stand_beside_its_own_trial_only(name, changed):
    trial = default_scenario(name)
    other = merge(trial, changed, "")
    assert claims_shown([trial]) == asked_of(name)
    figures = [claim.figure for claim in asked_of(name)]
    for scenarios in ([other], [trial, other]):
        assert {claim.paper for claim in claims_shown(scenarios)} == {"-"}
        assert [claim.figure for claim in claims_shown(scenarios)] == figures


def test_a_single_mode_of_hand_guiding_is_not_called_the_last():
    alone = merge(default_scenario("teach"), {"guide": {"mode": "gravity"}}, "")
    every = merge(default_scenario("teach"), {"guide": {"direction": "x"}}, "")
    labels = [[claim.label for claim in claims_shown([scenario])] for scenario in (alone, every)]
    assert labels[0][0] == "hand force, peak"
    assert labels[1][0] == "hand force, last mode, peak"
