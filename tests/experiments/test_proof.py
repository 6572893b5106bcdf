"""A plan is played in the cell before it is used: what fails is slowed or left out; then drawn parts pass."""

from contextlib import nullcontext
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from polish_sim.cell import Silent
from polish_sim.cell.guards import FALLEN, LOW, NO_STOP
from polish_sim.errors import PlanError, ReachError
from polish_sim.exchange import read_cuts, read_path, write_plan
from polish_sim.experiments import default_scenario, proof, run_experiment
from polish_sim.experiments.proof import Proven, Work, _Prover, prove, prove_with_a_pad_that_fits
from polish_sim.experiments.proof_play import Failure, Play
from polish_sim.experiments.proof_record import drift_notes, drift_of, proof_notes, why_not_proven
from polish_sim.planning import measure_given_path, plan_part
from polish_sim.planning.part_plan import EASED, IN_PART, LEFT_OUT, SLOWED, Mend, PreparedRegion
from polish_sim.planning.quality.access import HOLLOW
from polish_sim.planning.quality.areas import UNPLAYED, UNTOUCHED
from polish_sim.planning.quality.tool_room import CHECKED_APART
from polish_sim.planning.toolpath import LEAD_OUT
from polish_sim.scenario_file import override
from polish_sim.spatial import apply
from tests.kept import plate_file
from tests.planning.shapes import path_through


def straight(begin, end):
    """A line on the plate, whose top is 200 x 200 mm at z = 20 mm."""
    return path_through(np.linspace([*begin, 0.02], [*end, 0.02], 120))


def planned(scenario, path, cuts=()):
    return measure_given_path(path, scenario.part, scenario.plan, scenario.process, scenario.pad, cuts=cuts)


def pressing(*changes):
    """The plate under 40 N at 30 mm/s."""
    usual = [f"part.file={plate_file()}", "process.feed_m_s=0.03", "process.contact_force_n=40.0"]
    return override(default_scenario("surface"), [*usual, "safety.force_limit_n=80", *changes])


@cache
def across_the_plate():
    scenario = pressing()
    return scenario, planned(scenario, straight((-0.08, 0.0), (0.08, 0.0)))


SOFT = ("pad.stiffness_n_m=6000", "process.contact_force_n=36")


def into_the_corner(*changes):
    """Over the plate into its corner, where a quarter of the pad is left to carry the force."""
    scenario = pressing(*changes)
    return scenario, planned(scenario, straight((0.04, 0.04), (0.0995, 0.0995)))


def prover_of(scenario, plan):
    return _Prover(scenario, plan, Silent(), Work(plan))


@cache
def soft_corner():
    return into_the_corner(*SOFT)


@cache
def proven_at_the_corner():
    return prove(*soft_corner())


def assert_it_runs_on_a_drawn_part(proven):
    run = run_experiment(replace(proven.scenario, seed=501), proven.plan)
    assert run.stop_reason is None
    assert run.figures["path_done"] == 1.0
    assert run.figures["force_max_deviation_n"] < 4.0  # of the force asked for there


def test_a_proof_names_force_and_feed_of_the_path_and_a_force_that_falls_is_no_surface_that_rises():
    scenario, path = pressing(), straight((-0.02, 0.0), (0.02, 0.0))
    own = replace(path, force=np.full(120, 30.0), feed=np.linspace(0.01, 0.02, 120))
    proof = prove(scenario, planned(scenario, own)).plan.proof
    assert (proof["contact_force_n"], proof["feed_m_s"]) == (30.0, pytest.approx(0.02))
    # From 40 to 10 N the springs give way by 6 mm; the surface stays where it is.
    path = straight((0.0, 0.0), (0.06, 0.0))
    path = replace(path, force=np.interp(path.s, [0.02, 0.05], [40.0, 10.0]))
    assert run_experiment(scenario, planned(scenario, path)).stop_reason is None


def test_a_tool_that_leans_lands_with_its_rim_on_a_part_that_is_not_higher_than_planned():
    lean = np.radians(11.0)
    scenario = pressing(f"plan.tilt_angle_rad={lean}", "process.contact_force_n=20")
    path = straight((-0.02, 0.0), (0.02, 0.0))
    path = replace(path, axes_work=np.tile([0.0, np.sin(lean), np.cos(lean)], (120, 1)))
    proven = prove(scenario, planned(scenario, path)).plan
    assert (proven.mends, proven.proof["limits"]["part too high"]["share"] < 0.1) == ((), True)


@pytest.mark.parametrize(
    ("changes", "shares"), [((), [0.5]), (("pad.stiffness_n_m=10000", "plan.removal=even"), [0.5, 0.25])]
)
def test_where_the_corner_carries_a_share_of_the_force_it_is_pressed_with_that(changes, shares):
    scenario, plan = into_the_corner(*changes)
    assert run_experiment(replace(scenario, seed=501), plan).stop_reason is not None
    proven = prove(scenario, plan)
    assert LEFT_OUT not in {mend.what for mend in proven.plan.mends}
    assert {mend.share for mend in proven.plan.mends if mend.what == EASED} == {*shares}
    path, asked = proven.plan.path, scenario.process.contact_force_n
    np.testing.assert_array_equal(path.positions_work, plan.path.positions_work)
    force = path.force_at(path.s, asked)
    assert force[-1] == pytest.approx(shares[-1] * asked)
    assert force[0] == asked
    assert np.abs(np.gradient(force, path.s)).max() < 0.75 * asked / 0.0149  # [N/m] over half a second
    assert_it_runs_on_a_drawn_part(proven)


def test_a_place_that_fails_is_eased_before_it_is_left_out_and_then_more_of_it_where_it_fails_again():
    scenario, plan = across_the_plate()
    middle = 0.5 * plan.path.s[-1]
    for removal, shares in (("", [0.5]), ("even", [0.5, 0.25])):  # also where a place was eased before
        prover = prover_of(pressing(f"plan.removal={removal}"), plan)
        prover.pressed[:] = 0.7
        for _ in range(len(shares) + 1):
            prover._mend([Failure("the surface has fallen away", middle, FALLEN, False)])
        assert [mend.what for mend in prover.mends] == [*len(shares) * [EASED], LEFT_OUT]
        assert [mend.share for mend in prover.mends[:-1]] == shares
    for off, mended in ((0.1, EASED), (1.0, LEFT_OUT)):  # of half the force, with which contact is lost
        prover = prover_of(scenario, plan)
        prover.share[:] = 0.25
        wrong = off * 0.5 * scenario.process.contact_force_n
        prover._mend([Failure("the force leaves its band", middle, NO_STOP, False, wrong)])
        assert [mend.what for mend in prover.mends] == [mended]
    for aside_m, wider in ((0.0, 2.0), (0.008, 1.0)):  # not beside the cut of another line
        prover = prover_of(scenario, plan)
        fallen = Failure("the part is lower than planned", middle, LOW, False)
        alone = prover._remedy(fallen)[2].sum()
        cut = plan.path.positions_work[prover._row(fallen)] + [0.0, aside_m, 0.0]
        prover.mends.append(Mend(LEFT_OUT, "", 0.0, 0.001, cut[None]))
        assert prover._remedy(fallen)[2].sum() == pytest.approx(wider * alone, abs=2.0)  # rows of the path


def test_a_mended_path_is_cut_where_the_tool_would_stand_in_the_part(monkeypatch):
    scenario, plan = across_the_plate()
    prover = prover_of(scenario, plan)
    measure = PreparedRegion.measure

    def in_the_middle(self, path, cuts=()):
        quality = measure(self, path, cuts)
        there = path.positions_work[path.process & (np.abs(path.positions_work[:, 0]) < 0.002)]
        return replace(quality, pad_in_part=quality.pad_in_part._replace(positions=there))

    monkeypatch.setattr(PreparedRegion, "measure", in_the_middle)
    assert prover._keeps_clear(1.0)  # nothing was mended: the plan is as it was measured
    own = replace(prover.path, force=np.full(len(prover.path.s), 10.0))
    assert not prover_of(scenario, planned(scenario, own))._keeps_clear(1.0)  # it yields less
    prover._ease(prover.path.positions_work[:, 0] > 0.04, "a guard tripped", 0.5)
    assert not prover._keeps_clear(1.0)
    assert (prover.mends[-1].what, prover.mends[-1].why) == (LEFT_OUT, IN_PART)
    kept = prover.path.positions_work[prover.path.process]
    apart = CHECKED_APART * scenario.pad.radius_m
    assert np.abs(kept[:, 0]).min() == pytest.approx(0.002 + apart, abs=0.0011)  # its points are 1 mm apart
    assert prover.pressed.min() == 0.5
    assert prover._keeps_clear(1.0)  # it was cut, and is played again
    assert prove(scenario, replace(prover.plan, path=prover.place_now().path)).plan.figures["proven"]


def test_the_rest_of_a_path_keeps_the_dwell_of_its_even_removal():
    """What came before takes off as well: the rest made even on its own left out 4 cm^2."""
    line = straight((-0.08, 0.0), (0.08, 0.0))
    for begin_m, kept in ((0.0, False), (0.05, True)):
        scenario = pressing("plan.removal=even", f"plan.begin_m={begin_m}")
        plan = planned(scenario, replace(line, feed=np.linspace(0.02, 0.04, len(line.s)))).behind(begin_m)
        prover = prover_of(scenario, plan)
        prover._slow(prover.path.positions_work[:, 0] > 0.04, "a guard tripped", 0.25)
        prover._even_out()
        assert np.array_equal(prover.path.feed, plan.path.feed) == kept
        assert prover.share.min() == 0.25  # of the planned feed: it is not slowed again


def test_a_cut_path_is_proven_in_the_configuration_a_run_takes_on_the_side_it_presses(monkeypatch):
    """A run looks for one anew: of a dome it took another one than was played, and ran into itself."""
    prover = prover_of(*across_the_plate())
    turned = prover.place.reach._replace(q_start=prover.place.reach.q_start + 1.0)
    monkeypatch.setattr(proof.PartPlacing, "reach", lambda self: turned)
    monkeypatch.setattr(_Prover, "_play", None)  # it ends where it would be played
    for begin, play in ((-0.1, prover.pass_drawn), (-0.03, prover.pass_drawn), (0.0, prover.settle)):
        if cut := begin > -0.08:
            prover._leave_out(prover.path.positions_work[:, 0] < begin, "a guard tripped")
        with pytest.raises(TypeError):
            play(1)
        assert np.array_equal(prover.place_now().reach.q_start, turned.q_start) == cut
        assert bool(prover.place._kept) != cut  # sampled anew


def test_a_cut_path_the_arm_cannot_do_from_where_it_was_is_placed_and_played_anew(monkeypatch):
    prover = prover_of(*across_the_plate())
    whole = prover.path.positions_work
    elsewhere = prover.place.reach._replace(q_start=prover.place.reach.q_start + 1.0)
    follow = proof.check_whole_path

    def on_the_whole_path_alone(reach, positions, axes):
        if positions is not whole:
            raise ReachError("out of reach")
        return follow(reach, positions, axes)

    monkeypatch.setattr(proof, "check_whole_path", on_the_whole_path_alone)
    monkeypatch.setattr(proof.PartPlacing, "reach", lambda self: elsewhere)
    prover._leave_out(whole[:, 0] < -0.03, "a guard tripped")
    np.testing.assert_array_equal(prover.place_now().reach.q_start, elsewhere.q_start)
    assert prover.kept_until < 0.0  # no state of the play before holds


def test_where_the_pad_sinks_off_a_corner_the_path_is_left_out_and_what_stays_runs_on_a_drawn_part():
    (scenario, plan), proven = soft_corner(), proven_at_the_corner()
    assert run_experiment(replace(scenario, seed=501), plan).stop_reason is not None
    cut = np.concatenate([mend.places for mend in proven.plan.mends if mend.what == LEFT_OUT])
    assert np.abs(cut[:, :2] - 0.1).max() < 0.05  # [m], all of it near the corner
    kept = proven.plan.path.process
    assert np.isin(proven.plan.path.positions_work[kept], plan.path.positions_work).all()
    assert_it_runs_on_a_drawn_part(proven)


def with_pads_that_fit(monkeypatch, much, answer, choice="auto"):
    """How many pads are tried at the soft corner if proofs end with an answer, and the best of them."""
    scenario, plan = soft_corner()
    scenario = replace(scenario, pad=replace(scenario.pad, choice=choice))
    tried = []

    def proven(scenario, plan, observer, work):
        tried.append(scenario.pad.radius_m)
        return answer(len(tried), scenario, work)

    monkeypatch.setattr(proof, "prove", proven)
    monkeypatch.setattr(proof, "plan_removal", lambda scenario: plan)
    monkeypatch.setattr(proof, "MUCH", much)
    found = prove_with_a_pad_that_fits(scenario, plan)
    return len(tried), found


@pytest.mark.parametrize("error", [ReachError("out of reach"), PlanError("too narrow")])
def test_smaller_pads_that_cannot_be_used_or_take_too_long_leave_the_plan_with_the_first(monkeypatch, error):
    def only_the_first(number, scenario, work):
        if number > 1:
            raise error
        return proven_at_the_corner()

    def late(number, scenario, work):
        work.done_s, work.most_s = 2.0, 1.0
        return proven_at_the_corner()

    for answer, pads in ((only_the_first, 1 + proof.MOST_PADS), (late, 1)):
        assert with_pads_that_fit(monkeypatch, 0.0, answer) == (pads, proven_at_the_corner())


@pytest.mark.parametrize(
    ("reason", "choice", "pads"),
    [
        (HOLLOW, "auto", 1 + proof.MOST_PADS),
        (UNPLAYED, "auto", 1 + proof.MOST_PADS),
        ("at the border", "auto", 1),
        (HOLLOW, "stepover", 1),
    ],
)
def test_smaller_pads_are_tried_or_missed_where_it_is_too_hollow_for_the_first(
    monkeypatch, reason, choice, pads
):
    area = proven_at_the_corner().plan.area
    row = next(iter(area.left_out.values()))
    plan = replace(soft_corner()[1], area=replace(area, left_out={reason: row}))
    much = 0.5 * row.area_m2 / area.region_m2
    answer = lambda number, scenario, work: Proven(plan, scenario)  # noqa: E731
    tried, best = with_pads_that_fit(monkeypatch, much, answer, choice)
    assert tried == pads
    assert (best.plan.notes[-1:] == (proof.NO_SMALLER,)) == (choice == "stepover")


def five_minutes_in(strokes):
    """A plan of one or two strokes that presses for 300 s."""
    path = straight((-0.08, 0.0), (0.08, 0.0))
    segment = path.segment.copy()
    segment[60] = segment[60] if strokes == 1 else LEAD_OUT
    path = replace(path, segment=segment)
    return replace(across_the_plate()[1], path=path, figures={"time_in_contact_s": 300.0})


@pytest.mark.parametrize(
    ("settings", "strokes", "notes"),
    [
        (["sensor.model=ur5e-built-in"], 2, ["drift by 4.5 N"]),  # 6.5 N (1 - 1/e) + 0.02 N/s^0.5 sqrt(300 s)
        (["sensor.model=ur5e-built-in"], 1, ["4 N the force may be off"]),
        (["sensor.model=ur5e-built-in", "process.tare=strokes"], 2, []),  # 2.8 N in half the time
        (["sensor.model=ur5e-built-in", "sensor.warm_up_force_n=5"], 1, []),  # 3.5 N
        (["sensor.model=axia80"], 2, []),
    ],
)
def test_a_sensor_that_drifts_more_than_contact_takes_is_to_be_zeroed_by_stroke(settings, strokes, notes):
    asked = pressing(*settings)
    found = drift_notes(asked.process, asked.sensor, five_minutes_in(strokes))
    assert all(part in text for part, text in zip(notes, found, strict=True))


@pytest.mark.parametrize(
    ("force_n", "tare", "refused"),
    # Of sensors that warm up by 6.5 N at most half drift by 2.05 N in 300 s, by 1.28 N in half of it.
    [(8.0, "start", True), (8.5, "start", False), (6.0, "strokes", False), (5.0, "strokes", True)],
)
def test_a_path_on_which_half_of_all_sensors_drift_out_of_the_force_band_is_refused(force_n, tare, refused):
    words = "sensor.model=ur5e-built-in", f"process.tare={tare}", f"process.contact_force_n={force_n}"
    asked = pressing(*words)
    with pytest.raises(PlanError, match="drift") if refused else nullcontext():
        proof._refuse_drift(drift_of(asked.process, asked.sensor, five_minutes_in(2)))


def test_a_path_that_fails_everywhere_whatever_is_mended_is_refused_and_no_other_pad_is_tried(monkeypatch):
    scenario = pressing("process.contact_force_n=3", "sensor.force_drift_n_s=0.5")
    _, plan = across_the_plate()
    tried = []
    monkeypatch.setattr(proof, "plan_removal", tried.append)
    with pytest.raises(PlanError, match=r"\d+% of the path fails at any feed"):
        prove_with_a_pad_that_fits(scenario, plan)
    assert tried == []


@pytest.mark.parametrize(("tangential", "force"), [(0.7, 0.7), (0.8, 0.7), (0.7, 0.8), (0.8, 0.9)])
def test_each_figure_that_another_arm_may_miss_is_said_with_what_helps(tangential, force):
    """Of 110 and 163 runs of drawn plans the worst came 1.4 times as near as its proof."""
    shares = {"torque": 0.85, "tangential error": tangential, "force error": force}
    limits = {name: {"share": share, "at_m": 0.0} for name, share in shares.items()}
    notes = proof_notes({**proven_at_the_corner().plan.proof, "limits": limits, "mends": []})
    for figure, helps in (("tangential error", "lower --contact-force"), ("force error", "nearer to 16 N")):
        said = [note for note in notes if f"may fail run --check: {figure}" in note]
        assert bool(said) == (shares[figure] > 0.75)
        assert all(helps in note for note in said)


def test_a_proofs_time_is_that_of_the_plan_and_used_up_it_keeps_no_margin_or_is_refused(monkeypatch):
    scenario, plan = across_the_plate()
    work = Work(plan)
    monkeypatch.setattr(Play, "play_on", lambda self, observer: [])
    done = []
    for share in (1.0, 0.25):
        prover = _Prover(scenario, plan, Silent(), work)
        prover.share[:] = share
        prover.pass_through(None)
        done.append(work.done_s)
    assert done[1] > 2.0 * done[0] > 0.0  # slowed it takes longer
    assert work.most_s == Work(plan).most_s
    prover = prover_of(scenario, plan)
    prover.work.done_s = 1.4 * prover.work.most_s
    margins = []

    def fails_within_the_margin(self, observer):
        margins.append(self.margin)
        return [Failure("the force leaves its band", 0.01, NO_STOP, False)] if self.margin else []

    monkeypatch.setattr(Play, "play_on", fails_within_the_margin)
    begun = prover._play(None)
    begun.margin = 0.2  # begun before the time was used up
    begun.found = begun.play_on(Silent())
    prover.pass_through(None, begun)
    assert margins == [0.2, 0.0]
    assert prover.mends == []
    assert prover._play(None).margin == 0.0
    prover = prover_of(scenario, plan)
    middle = Failure("the force leaves its band: 9 N", 0.5 * plan.path.s[-1], NO_STOP, False)
    prover.work.done_s = 1.51 * prover.work.most_s
    monkeypatch.setattr(Play, "play_on", lambda self, observer: [middle])
    with pytest.raises(PlanError, match=r"from \d+ of \d+ mm of the path on"):
        prover.pass_through(None)


def test_a_path_whose_beginning_is_left_out_starts_with_the_arm_at_its_new_beginning():
    """Zeroed on the way there the sensor would be wrong, and guards that follow its noise blind."""
    scenario = pressing(*SOFT)
    plan = planned(scenario, straight((0.0995, 0.0995), (0.04, 0.04)))
    proven = prove(scenario, plan)
    begins = [path.positions_work[0] for path in (plan.path, proven.plan.path)]
    assert np.linalg.norm(begins[1] - begins[0]) > 0.01  # [m]
    run = run_experiment(proven.scenario, proven.plan)
    start = apply(np.array(proven.plan.figures["T_base_work"]), begins[1][None])[0]
    assert np.linalg.norm(run.log["tcp_position_m"][0] - start) < 0.003
    assert run.stop_reason is None


def test_a_proof_keeps_its_margin_to_every_limit_and_is_known_by_its_settings():
    proven = proven_at_the_corner()
    proof, path = proven.plan.proof, proven.plan.path
    assert proven.plan.figures["proven"] == 1
    shares = {name: limit["share"] for name, limit in proof["limits"].items()}
    assert shares.pop("tangential error") > 0.5  # what no mend helps is only said
    assert max(shares.values()) <= 0.8
    there = override(proven.scenario, [f"part.pose={list(proof['pose'])}"])
    for changes, named in (
        ("seed=77", ""), ("part.displacement_m=0.004", "part.displacement_m"),
        ("part.pose=[0.4, -0.4, 0.1, 0, 0, 0]", "another pose"),
        ("process.feed_m_s=0.04", "process.feed_m_s"), ("robot.arm=ideal", "robot.arm"),
        ("safety.proof='2'", "--proof 1"),
    ):  # fmt: skip
        doubt = why_not_proven(override(there, [changes]), path, proof)
        assert named in doubt
        assert bool(doubt) == bool(named)
    for begin, named in ((0.0, "another path"), (0.01, "--from")):
        rest = replace(there, plan=replace(there.plan, begin_m=begin))
        assert named in why_not_proven(rest, soft_corner()[1].path, proof)


def test_a_proven_plan_that_is_read_again_still_says_why_what_is_left_out(tmp_path):
    proven = prove(*into_the_corner("pad.stiffness_n_m=4000", "process.contact_force_n=36"))
    write_plan(tmp_path, proven.plan)
    again = planned(proven.scenario, read_path(tmp_path), read_cuts(tmp_path))
    rows, bare_rows = again.area.left_out, planned(proven.scenario, read_path(tmp_path)).area.left_out
    assert rows.keys() == proven.plan.area.left_out.keys() != bare_rows.keys()
    # The places are thinned in the file: where two reasons meet their border moves a little.
    for some in (rows.keys() & bare_rows.keys(), rows.keys() - bare_rows.keys()):
        lost = sum(proven.plan.area.left_out[reason].area_m2 for reason in some)
        assert sum(rows[reason].area_m2 for reason in some) == pytest.approx(lost, rel=0.05)


def test_what_the_pad_does_not_touch_when_a_plan_is_played_is_not_polished(tmp_path):
    scenario, plan = across_the_plate()
    proven = prove(scenario, plan)
    write_plan(tmp_path, proven.plan)
    area, before = proven.plan.area, plan.area
    assert before.polished_m2 - area.polished_m2 == pytest.approx(area.left_out[UNPLAYED].area_m2)
    again = planned(proven.scenario, read_path(tmp_path), read_cuts(tmp_path)).area
    assert again.figures["left_out"] == area.figures["left_out"]
    assert prove(scenario, proven.plan).plan.area.figures == area.figures
    # Where the feed ends early most of the path is not played.
    assert prove(override(scenario, ["process.max_feed_s=0.5"]), plan).plan.area.figures == before.figures
    drawn = replace(scenario, seed=501)
    bare, rest = (run_experiment(drawn, p).figures["left_out"][UNTOUCHED] for p in (plan, proven.plan))
    assert bare > max(1e-4, 4.0 * rest)


def test_a_path_on_which_the_gears_shake_the_arm_is_slowed_where_they_do():
    """Round the small sphere the wrist turns at 1 rad/s at 60 mm/s: its gear error shakes the sensor."""
    changes = ["part.file=sphere_50", "process.feed_m_s=0.06", "plan.stepover_m=0.02"]
    scenario = override(default_scenario("surface"), changes)
    proven = prove(scenario, plan_part(scenario.part, scenario.plan, scenario.process, scenario.pad))
    assert {mend.what for mend in proven.plan.mends} >= {SLOWED}
    assert proven.plan.path.feed.min() < 0.06
    figures = planned(scenario, proven.plan.path).figures
    for name in ("time_in_contact_s", "exposure_mean_s", "coverage"):
        assert proven.plan.figures[name] == pytest.approx(figures[name], rel=1e-6)
    assert run_experiment(replace(proven.scenario, seed=504), proven.plan).stop_reason is None


def test_a_path_with_nothing_to_stand_on_is_refused():
    scenario = pressing("pad.stiffness_n_m=4000", "process.contact_force_n=36")
    corner = planned(scenario, straight((0.0965, 0.0965), (0.0999, 0.0999)))
    with pytest.raises(PlanError, match="--pad-diameter"):
        prove(scenario, corner)
