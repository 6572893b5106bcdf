"""Feed and force that even the removal out, on the part as drawn."""

import tracemalloc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from polish_sim.analysis.inspect_plot import write_ply
from polish_sim.analysis.removal_plot import write_removal_mesh
from polish_sim.config import PlanConfig, Scenario
from polish_sim.errors import PolishSimError
from polish_sim.experiments import even_removal
from polish_sim.experiments.assembly import check, place_key
from polish_sim.experiments.even_removal import SMOOTH, _least_near, _Problem, even_out, plan_removal, planned
from polish_sim.experiments.surface import areas_after
from polish_sim.log import RemovalMap
from polish_sim.planning import plan_part
from polish_sim.planning.quality.areas import UNTOUCHED
from polish_sim.scenario_file import override
from tests.kept import plate_file

EVEN = Scenario(experiment="surface", plan=PlanConfig(removal="even", stepover_m=0.008, pattern="raster"))
EVEN = replace(EVEN, part=replace(EVEN.part, file=str(plate_file(140.0))))


@pytest.fixture(scope="module")
def plan():
    return plan_removal(EVEN)


@cache
def without_removal():
    return plan_part(EVEN.part, replace(EVEN.plan, removal=""))


def ramp(file, top=2.0):
    """A map over the plate's box that rises from 1 to ``top`` along x."""
    mesh = without_removal().ready.ground.mesh
    x = mesh.vertices[:, 0]
    target = 1.0 + (top - 1.0) * (x - x.min()) / np.ptp(x)
    colors = np.zeros((len(x), 3), dtype=np.uint8)
    on = mesh.vertices, mesh.normals, mesh.triangles
    write_ply(file, "ramp", on, colors, {"target": target})
    return file


def test_feed_makes_a_plate_even_within_its_limits(plan, monkeypatch):
    feed = plan.path.feed
    usual = EVEN.process.feed_m_s
    low, high = EVEN.plan.removal_feed
    assert low * usual * (1.0 - 1e-9) <= feed.min() < feed.max() <= high * usual * (1.0 + 1e-9)
    assert plan.figures["planned_removal_cv"] < 0.06
    assert plan.figures["planned_removal_cv_inside"] < 0.05
    force, asked = plan.path.force, EVEN.process.contact_force_n
    assert force.min() < 0.8 * asked
    assert force.max() <= asked * (1.0 + 1e-9)
    problem = _Problem(EVEN, plan)
    assert problem.depths.max() < 1.2 * problem.deepest  # the pad does not sink
    assert problem.deepest == pytest.approx(0.0025)
    monkeypatch.setattr(even_removal, "QUICK", 0.0)
    slow = even_out(EVEN, plan)
    spent = [np.sum(np.diff(p.path.s) / p.path.feed[1:], where=p.path.process[1:]) for p in (plan, slow)]
    assert spent[0] < 0.99 * spent[1]
    assert plan.figures["planned_removal_cv"] < slow.figures["planned_removal_cv"] + 0.01
    assert check(EVEN).controller.moment_tilt_limit_rad == 0.0  # the tool keeps its planned axis
    assert check(check(EVEN)) == check(EVEN)
    assert check(Scenario()) == Scenario()


def test_no_feed_nearby_is_better_and_force_by_turns_does_not_make_it_worse(plan):
    """No small change of the dwell at a knot lowers deviation or time without raising the other by more."""
    problem = _Problem(EVEN, plan)
    slowness = 1.0 / np.interp(problem.knot_s, plan.path.s, plan.path.feed)
    weights = problem.weights * problem.importance

    def distance(slowness):
        off = problem.exposure(slowness) / problem.goal - 1.0
        return float(0.5 * weights @ off**2 + problem.quick @ slowness)

    best = distance(slowness)
    rng = np.random.default_rng(7)
    low, high = (1.0 / (share * EVEN.process.feed_m_s) for share in EVEN.plan.removal_feed[::-1])
    for _ in range(20):
        assert distance(np.clip(slowness * rng.uniform(0.9, 1.1, len(slowness)), low, high)) > best
    both = plan_removal(replace(EVEN, plan=replace(EVEN.plan, removal_force=0.3)))
    assert both.figures["planned_removal_cv"] < plan.figures["planned_removal_cv"] + 1e-3


def test_a_ramp_of_one_to_two_is_followed(tmp_path):
    plan = plan_removal(replace(EVEN, plan=replace(EVEN.plan, removal=str(ramp(tmp_path / "ramp.ply")))))
    assert plan.figures["planned_removal_cv"] < 0.06
    path, x = plan.path, plan.path.positions_work[:, 0]
    middle = path.process & (np.abs(path.positions_work[:, 1] - np.median(path.positions_work[:, 1])) < 0.03)
    slow, fast = (np.mean(path.feed[middle & some]) for some in (x > np.median(x), x < np.median(x)))
    assert fast > 1.2 * slow
    for change in ({"removal": "no_such_map.ply"}, {"removal_feed": (2.0, 0.4)}):  # cannot be followed
        with pytest.raises(PolishSimError):
            check(replace(EVEN, plan=replace(EVEN.plan, **change)))
    check(replace(EVEN, dual=replace(EVEN.dual, standoff_m=0.005)), path)  # at a stand-off along a plan


def test_a_region_under_a_share_of_the_mean_is_where_too_little_came_off(tmp_path):
    ready = without_removal().ready
    mesh = ready.ground.mesh
    x = mesh.vertices[:, 0]
    exposure = np.where(x > np.median(x), 3.0, 1.0)
    on = mesh.vertices, mesh.normals, mesh.triangles, mesh.vertex_areas
    file, up = tmp_path / "removal.ply", np.array([0.0, 0.0, 1.0])
    write_removal_mesh(file, RemovalMap(*on, exposure, up, 0.0, 0.0, 0.0, 1.0))
    region = f"under:{file}:0.8"
    again = plan_part(EVEN.part, PlanConfig(region=region, stepover_m=0.03))
    assert again.ready.region.area_m2 == pytest.approx(0.5 * ready.region.area_m2, rel=0.03)
    away, nearest = cKDTree(mesh.vertices).query(again.ready.ground.mesh.vertices)
    assert np.mean(exposure[nearest[away < 0.002]] == 1.0) > 0.95


def test_what_a_run_does_not_touch_is_left_out_for_its_plans_reason_or_as_untouched():
    plan = without_removal()
    mesh, path = plan.ready.ground.mesh, plan.path
    rest = plan.behind(float(np.median(path.s[path.process])))
    on = mesh.vertices, mesh.normals, mesh.triangles, mesh.vertex_areas
    right = (mesh.vertices[:, 0] > np.median(mesh.vertices[:, 0])).astype(float)
    for whole, exposure in ((plan, right), (rest, 0.0 * right)):
        found = areas_after(whole, RemovalMap(*on, exposure, np.zeros(3), 0.0, 0.0, 0.0, 1.0))
        touched = found["coverage"] * whole.area.region_m2
        assert touched == pytest.approx(on[-1] @ exposure, rel=1e-6)
        assert found["polished_area_m2"] + found["left_out_area_m2"] == pytest.approx(whole.area.region_m2)
        before = whole.ready.asked.why >= 0  # the places are polished before, and some again
        twice = whole.ready.asked.areas[before & (whole.area.why < 0)].sum()
        known = {reason: area + twice for reason, area in whole.figures["left_out"].items()}
        known[UNTOUCHED] = whole.area.polished_m2 - touched - twice
        assert found["left_out"] == pytest.approx(known, rel=1e-6)


def test_with_less_force_and_a_slower_feed_somewhere_the_dwell_is_found_again(plan):
    """As the proof mends a path: its force and largest feeds are given; 95% of what can be is made up for."""
    path = plan.path
    at = path.process & (np.abs(path.positions_work[:, 0]) < 0.03)
    force = np.where(at, 0.5, 1.0) * path.force_at(path.s, EVEN.process.contact_force_n)
    slow = path.process & (path.positions_work[:, 1] > 0.04)
    most = np.where(slow, 0.008, np.inf)
    mended = replace(plan, path=replace(path, force=force, feed=np.minimum(path.feed, most)))
    again = even_out(EVEN, mended, most=most)
    np.testing.assert_array_equal(again.path.force, force)
    assert again.path.feed[slow].max() <= 0.008 * (1.0 + 1e-9)
    problem = _Problem(EVEN, mended, again=True)
    feeds = mended.path.feed, again.path.feed
    stale, found = (1.0 / np.interp(problem.knot_s, path.s, feed) for feed in feeds)
    low, high = problem.limits(most)
    by = np.sqrt(problem.weights * problem.importance) / problem.goal
    smooth = np.sqrt(SMOOTH / len(low)) * np.diff(np.eye(len(low)), axis=0) / np.sqrt(low * high).min()
    columns = np.concatenate([by[:, None] * problem.dwell_columns().toarray(), smooth])
    wanted = np.concatenate([by * (problem.goal - problem.landing), np.zeros(len(smooth))])
    missed = columns @ found - wanted
    gained = np.sum((columns @ stale - wanted) ** 2) - np.sum(missed**2)
    gained += 2.0 * problem.quick @ (stale - found)
    slope = 2.0 * (missed @ columns + problem.quick)
    # The problem is convex: along its slope no dwell within the limits gains more than this.
    assert slope @ (found - np.where(slope > 0.0, low, high)) < 0.05 * gained
    assert sum(note.startswith("removal planned") for note in again.notes) == 1


def test_another_feed_in_the_same_process_is_planned_anew_and_a_changed_map_is_another_place(tmp_path):
    asked = replace(EVEN, plan=replace(EVEN.plan, stepover_m=0.02))
    feeds = (replace(asked, process=replace(asked.process, feed_m_s=feed)) for feed in (0.02, 0.04))
    slow, fast = (planned(scenario)[1].path.feed for scenario in feeds)
    assert slow.mean() < 0.7 * fast.mean()
    asked = replace(EVEN, plan=replace(EVEN.plan, removal=str(tmp_path / "map.ply")))
    keys = []
    for text in ("one", "two more"):
        (tmp_path / "map.ply").write_text(text, encoding="utf-8")
        keys.append(place_key(asked))
    assert keys[0] != keys[1]


def test_the_least_near_a_knot_is_that_of_all_pairs_in_memory_that_grows_with_the_path_not_its_square():
    rng = np.random.default_rng(3)
    knots, s = np.sort(rng.uniform(0.0, 1.0, 40)), np.sort(rng.uniform(0.0, 1.0, 60))
    values, apart = rng.uniform(1.0, 2.0, 60), 0.1
    pairs = np.where(np.abs(np.subtract.outer(knots, s)) <= apart, values, np.inf).min(axis=1)
    assert np.isfinite(pairs).all()
    np.testing.assert_array_equal(_least_near(knots, apart, s, values), pairs)
    # A path of 13 m took 3.5 GB.
    knots, s = np.linspace(0.0, 50.0, 4000), np.linspace(0.0, 50.0, 25_000)
    tracemalloc.start()
    _least_near(knots, 0.02, s, s)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50 * 8 * len(s)


def test_a_strip_without_an_inside_says_no_figure_of_it_and_a_pad_that_does_not_slide_is_refused(tmp_path):
    trimesh.creation.box((90, 44, 10)).export(tmp_path / "strip.stl")
    strip = replace(EVEN.part, file=str(tmp_path / "strip.stl"), unit="mm", up="z")
    plan = plan_removal(replace(EVEN, part=strip, pad=replace(EVEN.pad, choice="given")))
    assert np.isnan(plan.figures["planned_removal_cv_inside"])
    (note,) = (note for note in plan.notes if note.startswith(even_removal.PLANNED))
    assert "nan" not in note
    assert "at one feed" in note
    # Its sliding is the feed: what comes off follows from force and way, however slow it goes.
    still = override(EVEN, ["spindle.speed_rpm=0"])
    with pytest.raises(PolishSimError, match="turns or slides"):
        check(still)
    check(override(still, ["pad.slide_m_s=1"]))
