"""Figures of synthetic traces with known answers; what is asked of them, and when it counts as met."""

import math
from dataclasses import replace

import numpy as np
import pytest

from polish_sim.analysis import metrics
from polish_sim.analysis.claim import Claim, bound_text, shortfalls, value_text
from polish_sim.dual import CALIBRATIONS
from polish_sim.experiments.registry import claims_shown, default_scenario, experiment, experiments
from polish_sim.experiments.rows import PAYLOAD_CLAIMS
from polish_sim.hand_guiding.drag import measure_taught
from polish_sim.identification import IDENTIFY
from polish_sim.log import Trace
from polish_sim.planning.toolpath import BEFORE
from polish_sim.scenario_file import merge, override
from tests.analysis.synthetic import arc_trace, bumpy_path, force_trace, removal_map, surface_trace, trace_of
from tests.planning.shapes import path_through


def test_a_first_order_force_response_has_the_textbook_figures_and_settles_after_its_last_excursion():
    figures = metrics.measure_force(force_trace(tau=0.1), 20.0)
    # contact is noticed at 0.5 N, that is tau ln(20/19.5) after the touch
    late = 0.1 * math.log(20.0 / 19.5)
    assert figures["contact_time_s"] == pytest.approx(2.0 + late, abs=2e-3)
    assert figures["settling_time_3n_s"] == pytest.approx(0.1 * math.log(20.0 / 3.0) - late, abs=2e-3)
    assert figures["settling_time_1n_s"] == pytest.approx(0.1 * math.log(20.0) - late, abs=2e-3)
    assert figures["rise_time_s"] == pytest.approx(0.1 * math.log(9.0), abs=2e-3)
    assert figures["steady_max_deviation_n"] == pytest.approx(20.0 * math.exp(-(0.5 + late) / 0.1), rel=0.02)
    assert figures["steady_within_3n"] == 1.0
    assert figures["steady_std_n"] < 0.1  # the retract is no loss of force
    assert figures["overshoot_n"] == 0.0
    harder = metrics.measure_force(force_trace(contact_force=25.0), 20.0)
    assert harder["overshoot_n"] == pytest.approx(5.0, abs=1e-3)
    in_air = trace_of(np.zeros(1000, np.int8))
    assert all(math.isnan(value) for value in metrics.measure_force(in_air, 20.0).values())
    figures = metrics.measure_surface(in_air, bumpy_path(), 20.0)
    assert math.isnan(figures["force_rms_error_n"])
    assert math.isnan(figures["force_error_at_peaks_n"])
    assert figures["curvature_peaks"] == 0
    time = np.arange(0.0, 3.0, 1e-3)
    error = np.where((time > 1.0) & (time < 1.5), 5.0, 0.0)
    assert abs(metrics.settling_time(time, error, 3.0) - 1.5) <= 1e-3
    assert metrics.settling_time(time, np.full_like(time, 3.0), 3.0) == 0.0
    for bad in (np.linspace(0.0, 10.0, len(time)), np.full_like(time, math.nan), np.empty(0)):
        assert math.isnan(metrics.settling_time(time[: len(bad)], bad, 3.0))
    assert math.isnan(metrics.rise_time(time, np.full_like(time, 17.9), 20.0))  # below 90 percent
    assert metrics.moving_average(time[:20], time[:20], 0.05).size == 0  # shorter than the window


def test_a_constant_radial_error_and_a_slow_ripple_of_the_speed_are_those_of_the_arc():
    figures = metrics.measure_arc(arc_trace(radial_error_m=7e-5))
    assert figures["tracking_error_max_m"] == pytest.approx(7e-5, abs=1e-12)
    assert figures["tracking_error_rms_m"] == pytest.approx(7e-5, abs=1e-12)
    assert figures["speed_mean_m_s"] == pytest.approx(0.01)
    assert figures["speed_max_deviation_m_s"] == pytest.approx(0.0, abs=1e-12)
    centre, normal = np.asarray(metrics.PAPER_ARC.center), np.asarray(metrics.PAPER_ARC.normal)
    rim_top = centre + np.array([0.0, 0.0, metrics.PAPER_ARC.radius])
    points = np.array([centre, rim_top, rim_top + 0.03 * normal])
    assert metrics.distance_to_arc(points) == pytest.approx([0.1, 0.0, 0.03], abs=1e-12)
    # But for the first second: the 50 ms average of a 0.5 Hz sine keeps sinc(0.025) of it.
    trace = arc_trace(ripple_m_s=2e-4)
    ramped = trace._replace(tcp_speed_m_s=np.where(trace.time_s < 0.99, 0.0, trace.tcp_speed_m_s))
    known = pytest.approx(2e-4 * np.sinc(0.025), rel=1e-4)
    assert metrics.measure_arc(ramped)["speed_max_deviation_m_s"] == known


def test_every_bump_of_the_path_is_one_curvature_peak_and_a_dip_of_force_there_its_error():
    path = bumpy_path(bumps=6)
    assert path.s[metrics.curvature_peaks(path)] == pytest.approx(np.arange(0.1, 1.2, 0.2), abs=1e-3)
    for sharpness, count in ((-1 / 0.06, 4), (1 / 0.3, 0)):  # hollows count like humps, gentle ones do not
        assert len(metrics.curvature_peaks(bumpy_path(bumps=4, sharpness=sharpness))) == count
    rippled = path.curvature + 1.0 * np.sin(path.s / 0.0005)
    assert len(metrics.curvature_peaks(replace(path, curvature=rippled))) == 6
    s = np.linspace(0.0, 2.0, 200_000)
    noise = np.random.default_rng(1).normal(0.0, 1.0, len(s))
    errors = metrics.errors_at_peaks(bumpy_path(bumps=10), s, noise)
    assert errors.at_peaks_n == pytest.approx(errors.between_peaks_n, rel=0.1)
    path = bumpy_path(bumps=6)
    trace = surface_trace(path, dip_n=5.0)
    figures = metrics.measure_surface(trace, path, 20.0)
    assert figures["curvature_peaks"] == 6
    assert figures["force_error_at_peaks_n"] == pytest.approx(5.0, abs=0.01)
    assert figures["force_error_between_peaks_n"] < 0.1
    assert figures["force_max_deviation_n"] == pytest.approx(5.0, abs=0.01)
    # a Gaussian dip of depth 5 N is deeper than 4 N on +-0.668 of its width
    outside = 6 * 2 * 0.005 * math.sqrt(2 * math.log(5 / 4)) / (path.s[-21] - path.s[20])
    assert figures["force_within_4n"] == pytest.approx(1.0 - outside, abs=1e-3)
    assert figures["contact_lost_s"] == 0.0
    assert figures["speed_mean_m_s"] == pytest.approx(0.01)
    lost = np.where((trace.time_s >= 50.0) & (trace.time_s < 50.25), 0.0, trace.normal_force_n)
    figures = metrics.measure_surface(trace._replace(normal_force_n=lost), path, 20.0)
    assert figures["contact_lost_s"] == pytest.approx(0.25)
    until = int(np.searchsorted(trace.path_s_m, 0.5 + metrics.WINDOW_M))
    figures = metrics.measure_surface(Trace(*(column[:until] for column in trace)), path, 20.0)
    assert figures["curvature_peaks"] == 3


def test_a_force_that_uses_all_it_may_be_off_is_where_the_run_begins_to_be_called_bad():
    """A blow is a quarter above the set force, anywhere; the band and contact count where it is held."""
    force = np.array([10.0, 24.0, 23.0, 0.5, 24.0, 0.5, 4.0])
    wanted = np.array([8.0, 20.0, 20.0, 2.0, 20.0, 2.0, 8.0])
    most = np.array([8.0, 20.0, 20.0, 8.0, 20.0, 8.0, 8.0])
    held = np.array([False, True, True, True, False, False, True])
    shares = [metrics.force_shares(*row) for row in zip(force, wanted, most, held, strict=True)]
    ever, often = np.transpose(shares)
    np.testing.assert_allclose(often, [0.0, 1.0, 0.75, 0.375, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(ever[[0, 1, 3, 4]], [1.0, 0.8, 1.0, 0.8])
    assert ever[5] <= 0.0  # no contact to lose where the force is not held yet
    calm = {"contact_lost_s": 0.0, "force_within_4n": 1.0}
    for peak, bad in ((9.99, 0), (10.01, 1)):
        assert len(metrics.faults_of_force({**calm, "peak_force_n": peak}, 8.0)) == bad


def test_removal_beside_what_was_polished_before_is_of_this_run_alone_and_a_lone_vertex_has_no_spread():
    before = {"region_area_m2": 65e-4, "left_out": {BEFORE: 1e-3}}
    (note,) = metrics.map_notes(before, default_scenario("surface"))
    assert "of this run alone" in note
    assert not metrics.map_notes(before | {"region_area_m2": 0.2}, default_scenario("surface"))
    places = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.4, 0.4, 0.0]])
    border = np.array([[0, 1], [1, 2], [2, 0]])  # a lone vertex inside it has no spread
    whole, inside = metrics.spreads(np.array([0.5, 1.0, 1.0, 1.5]), np.ones(4), places, border, 0.5)
    assert whole > 0.3
    assert np.isnan(inside)


def test_a_path_taught_two_millimetres_high_and_too_short():
    x = np.arange(0.0, 0.1 + 1e-9, 0.001)
    meant = path_through(np.column_stack([x, 0.0 * x, 0.0 * x]), (0.0, 0.0, 1.0))
    points = np.column_stack([x, 0.0 * x, 0.0 * x + 0.002])[:91]
    figures = measure_taught(points, path_through(points, (0.0, np.sin(0.1), np.cos(0.1))), meant)
    assert figures["taught_deviation_max_m"] == pytest.approx(0.002)
    assert figures["recorded_deviation_rms_m"] == pytest.approx(0.002)
    assert figures["taught_missed_max_m"] == pytest.approx(np.hypot(0.01, 0.002))
    assert figures["taught_axis_error_max_rad"] == pytest.approx(0.1)


def test_a_target_that_catches_up_while_it_brakes_is_not_at_its_feed_again():
    """At 10 mm/s, braked for 1 s; cycles that the host missed there are made up in one step."""
    time = np.arange(0.0, 5.0, 0.001)
    s = 0.01 * time - 0.5 * 0.01 * np.maximum(time - 4.0, 0.0) ** 2
    s[4700:4704] = s[4700]
    assert np.diff(s)[4703] > 0.99e-5
    steady = metrics.steady_feed(time >= 0.0, time, s)
    assert time[steady][-1] == pytest.approx(4.01, abs=0.003)


def asked_of(name):
    row = experiment(name)
    return row.claims(row.defaults)


def test_every_claim_names_a_figure_a_good_arc_meets_all_and_a_wide_one_misses_the_tracking_error():
    path, removal = bumpy_path(), metrics.measure_removal(removal_map(np.ones(5)))
    for name, figures in (
        ("arc", metrics.measure_arc(arc_trace())),
        ("force", metrics.measure_force(force_trace(), 20.0)),
        ("surface", metrics.measure_surface(surface_trace(path), path, 20.0) | removal),
    ):
        known = {*figures, "path_done", "cycle_time_s", "coverage"}
        assert {claim.figure for claim in asked_of(name)} <= known
    ideal = experiment("arc").claims(override(default_scenario("arc"), ["robot.arm=ideal"]))
    good, wide = (metrics.measure_arc(arc_trace(off)) | {"path_done": 1.0} for off in (5e-5, 2e-4))
    assert shortfalls(ideal, good) == []
    assert [claim.figure for claim in shortfalls(ideal, wide)] == ["tracking_error_max_m"]
    assert shortfalls(asked_of("arc"), wide) == []
    assert [claim.figure for claim in shortfalls(asked_of("arc"), wide | {"path_done": 0.5})] == ["path_done"]


def test_an_undefined_figure_meets_no_bound_the_worst_seed_is_the_least_good_and_lower_bounds_ask_for_more():
    assert not Claim("x", "x", "N", high=1.0).met_by(math.nan)
    assert Claim("x", "x", "N").met_by(math.nan)
    claim = Claim("x", "x", "mm", low=5e-5, high=1e-4)
    assert (bound_text(claim), value_text(claim, math.nan)) == ("0.05 to 0.1", "-")
    assert Claim("x", "x", "%", more_is_better=True).worst_of([0.9, 0.7, 0.8]) == 0.7
    assert Claim("x", "x", "N", high=0.5).worst_of([0.1, 0.4, 0.2]) == 0.4
    assert math.isnan(Claim("x", "x", "N", high=0.5).worst_of([0.1, math.nan]))
    assert math.isnan(Claim("x", "x", "N", high=0.5).worst_of([]))
    assert math.isnan(Claim("x", "x", "N", is_mean=True).worst_of([0.1, 0.2]))
    tables = [*map(asked_of, experiments()), *CALIBRATIONS.values(), *IDENTIFY.values(), PAYLOAD_CLAIMS]
    for claim in (claim for claims in tables for claim in claims):
        assert claim.more_is_better or math.isinf(claim.low)


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("arc", {"process": {"feed_m_s": 0.02}}), ("force", {"part": {"file": "freeform"}}),
        ("surface", {"process": {"contact_force_n": 12.0}}), ("surface", {"plan": {"file": "mine.csv"}}),
        ("smooth", {"plan": {"file": "mine.csv"}}),
    ],
)  # fmt: skip
def test_the_paper_s_figures_stand_beside_its_own_trial_only(name, changed):
    trial = default_scenario(name)
    other = merge(trial, changed, "")
    assert claims_shown([trial]) == asked_of(name)
    figures = [claim.figure for claim in asked_of(name)]
    for scenarios in ([other], [trial, other]):
        assert {claim.paper for claim in claims_shown(scenarios)} == {"-"}
        assert [claim.figure for claim in claims_shown(scenarios)] == figures


def test_a_single_mode_of_hand_guiding_is_not_called_the_last():
    for key, value, label in (("mode", "gravity", "peak"), ("direction", "x", "last mode, peak")):
        scenario = merge(default_scenario("teach"), {"guide": {key: value}}, "")
        assert claims_shown([scenario])[0].label == f"hand force, {label}"
