"""Prove a plan: play it in the cell on the part as drawn, mend what fails where it fails, and play it again.

The guards get limits tighter by a margin, so that a part that is displaced and bent as the scenario draws it
runs too. Where a guard trips or the exact force leaves its band, the tool is slowed over that stretch; where
slowing does not help, or the pad sinks off an edge, it is pressed with half the force there, and by an even
removal, which makes up for it, then with a quarter; where that fails as well, or the pad has lost the part,
the stretch is left out and the tool lifts over it. Each mended path resumes from a state saved shortly
before the place. A path that was mended is at last played whole: only that is the proof, and what the pad
did not touch in it is left out of the plan's area.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import parent_process
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.analysis.metrics import CONTACT_N
from polish_sim.analysis.run_record import changed_words
from polish_sim.arrays import Bools, Indices, diagonal_of, norms
from polish_sim.cell import SILENT, Observer
from polish_sim.cell import guards as guard
from polish_sim.cell.dwell import would_sink
from polish_sim.cell.guards import NO_STOP
from polish_sim.cell.real_part import NORMAL_SHARE
from polish_sim.config import LEAST_FORCE_N, Checked, PadConfig, PlanConfig
from polish_sim.control.signals import CompiledController
from polish_sim.errors import PlanError, PolishSimError, ReachError, place_in_mm
from polish_sim.experiments.assembly import (
    Workplace,
    config_hash,
    kept_place,
    proof_seeds,
)
from polish_sim.experiments.even_removal import even_out, plan_removal, planned
from polish_sim.experiments.part_pose import PartPlacing
from polish_sim.experiments.placement import Reach, check_whole_path
from polish_sim.experiments.proof_play import DYNAMIC, Failure, Play
from polish_sim.experiments.proof_record import (
    Drift,
    drift_notes,
    drift_of,
    path_key,
    proof_notes,
    proof_settings,
)
from polish_sim.experiments.registry import default_scenario
from polish_sim.experiments.surface import prepare_surface
from polish_sim.planning import PlanResult
from polish_sim.planning.moves.stroke import Remaining, lift_over
from polish_sim.planning.part_plan import (
    EASED,
    IN_PART,
    LEFT_OUT,
    PAD_SIZES_M,
    SLOWED,
    Mend,
    is_free,
    mend_of,
    out_of_part,
    with_pad,
)
from polish_sim.planning.quality.access import HOLLOW
from polish_sim.planning.quality.areas import UNPLAYED, CutOut
from polish_sim.planning.toolpath import stretches
from polish_sim.spatial import to_pose

SLOWER = 0.5  #: A stretch that fails is slowed to this share of its feed
SLOWEST = 0.2  #: Share of the planned feed below which slowing is given up
PLAYED = "when it was played, "
SINKS_OFF = "the pad would sink off an edge of a part that lies aside"
LOOKED_M = 1e-3  #: Places of the path at which that is looked at are so far apart [m]
MUCH = 0.05  #: Share of the region from which a smaller pad is tried, by `_lost`
MUCH_SMALLER, MOST_PADS = 0.7, 2  #: Share of the pad's size from which on others are tried, and how many
LEAST_POLISHED = 0.1  #: Share of the region below which a plan is refused
MOST_FAILED = 0.5  #: Share of the path at which neither feed nor force helps, above which it is refused
WORTH_A_PAD = 1.02  #: Times as much it has to polish
EASIER = 0.5  #: A stretch that fails is pressed with this share of its force
EASIEST = 0.25  #: Share of the force below which easing is given up by an even removal; else `EASIER`
SLOWING_S = 0.5  #: Of the feed before a place that is mended may have changed too [s]
AROUND_S = 0.5  #: A stretch is slowed for this long before and behind the place that fails [s]
AROUND_M = 0.004  #: And for at least this far [m]
MOST_SLOWED = 20  #: Times a stretch is slowed after which the rest of the path is, too
#: What all pads together may play and time, in times the path's time in contact as it was planned, and at
#: least so long [s]; then no margin is kept, and after half as much again the plan is refused
MOST_WORK, LEAST_WORK_S = 8.0, 8000.0
FORCE_FAILS = (NO_STOP, *DYNAMIC)
"""What a pad of another size does not help where neither feed nor force does."""
HOPELESS = (guard.CONTROLLER_NAN, guard.CONTROLLER_ERROR, guard.UNSTABLE)
"""What no other path mends."""


NO_SMALLER = "no smaller pad was tried, as the step-over is given: leave --stepover out or set --pad-diameter"


class _Hopeless(PlanError):
    """What no mend and no other pad helps."""


class Work:
    """What proving a plan has taken and may take, whatever pads it is tried with [s of the cell's time]."""

    def __init__(self, plan: PlanResult) -> None:
        self.most_s = max(MOST_WORK * plan.figures["time_in_contact_s"], LEAST_WORK_S)
        self.done_s = 0.0  #: Played and timed

    @property
    def used(self) -> float:
        """Share of what may be taken with all the margins [-]."""
        return self.done_s / self.most_s


class Proven(NamedTuple):
    """A plan as it was played to its end, and the scenario it runs in."""

    plan: PlanResult  #: Its path slowed and cut, its ``proof`` says what was played
    scenario: Checked  #: Its part stands where it was played


def prove(
    scenario: Checked, plan: PlanResult, observer: Observer = SILENT, work: Work | None = None
) -> Proven:
    """Play a plan on the part as drawn, and on as many drawn parts as ``safety.proof`` says; mend what fails.

    Raises:
        PlanError: Nothing of the path can be polished, or no mend helps; says why and where.
        PolishSimError: As of `prepare_surface`.
    """
    _refuse_drift(drift_of(scenario.process, scenario.sensor, plan))
    prover = _Prover(scenario, plan, observer, work or Work(plan))
    seeds = range(scenario.seed + 1, scenario.seed + 1 + proof_seeds(scenario.safety.proof))
    begun = prover.pass_drawn(seeds[0]) if seeds else None
    before = len(prover.mends)
    for seed in seeds or (None,):
        prover.settle(seed, begun)
        begun = None
    if len(prover.mends) > before:
        for seed in seeds[:-1]:
            prover.settle(seed)
    return prover.result()


def _refuse_drift(drift: Drift) -> None:
    """Refuse a path on which the zero of half of all sensors drifts by more than the force may be off.

    Raises:
        PlanError: It does before the sensor is zeroed again.
    """
    if drift.half > drift.band:
        strokes = "process.tare=strokes, " if drift.strokes else ""
        raise _Hopeless(
            f"half of all sensors drift by more than {drift.half:.2g} N in the {drift.time:.0f} s before "
            f"they are zeroed again, and {drift.force:.3g} N may be off by {drift.band:.2g} N: set {strokes}"
            "another sensor.model, a larger --contact-force or a faster --feed; --proof none plans it all "
            "the same."
        )


def prove_with_a_pad_that_fits(scenario: Checked, plan: PlanResult, observer: Observer = SILENT) -> Proven:
    """As `prove`; where playing it leaves out much, smaller pads are tried, unless the user asked for this
    one.

    Raises:
        PolishSimError: As of `prove`, of the first pad.
    """
    best: Proven | None = None
    failed: list[PolishSimError] = []
    work = Work(plan)
    for pad, asked in _pads_from(scenario.pad, scenario.plan, plan.tool.pad):
        if work.used > 1.0:
            break
        try:
            other = replace(scenario, pad=pad, plan=asked)
            made = plan if pad is scenario.pad else plan_removal(other)
            found = prove(replace(scenario, pad=pad), made, observer, work)
            refuse_almost_nothing(found.plan)
        except PolishSimError as error:
            if pad is scenario.pad and not isinstance(error, PlanError):
                raise
            failed.append(error)
            if isinstance(error, _Hopeless):
                break
            continue
        if best is None or _pressed(found.plan) > WORTH_A_PAD * _pressed(best.plan):
            best = found
        area = found.plan.area
        if _lost(found.plan) + area.polished_m2 - _pressed(found.plan) < MUCH * area.region_m2:
            break
        if scenario.pad.choice == "stepover" and is_free(scenario.pad) and not scenario.plan.file:
            best = found._replace(plan=replace(found.plan, notes=(*found.plan.notes, NO_SMALLER)))
    if best is None:
        raise failed[0]
    return best


def refuse_almost_nothing(plan: PlanResult) -> None:
    """Refuse a plan that polishes next to nothing of the region asked for.

    Raises:
        PlanError: Saying how much, and why the most of the rest is left out.
    """
    area = plan.area
    if area.polished_m2 >= LEAST_POLISHED * area.region_m2:
        return
    reason, row = next(iter(area.left_out.items()))
    raise PlanError(
        f"only {1e4 * area.polished_m2:.3g} of the region's {1e4 * area.region_m2:.3g} cm^2 would be "
        f"polished; {1e4 * row.area_m2:.3g} cm^2 are left out: {reason}. Set another --pad-diameter, another "
        "--region or --up."
    )


def _pads_from(given: PadConfig, asked: PlanConfig, pad: PadConfig) -> Iterator[tuple[PadConfig, PlanConfig]]:
    """The pad that is given, then ones smaller than the ``pad`` a plan has with the step-over in proportion,
    each with what is to be planned."""
    yield given, asked
    if given.choice == "auto" and is_free(given) and not asked.file:
        smaller = [size for size in PAD_SIZES_M if size < MUCH_SMALLER * 2.0 * pad.radius_m]
        for size in smaller[:MOST_PADS]:
            yield with_pad(given, asked, size)


def _lost(plan: PlanResult) -> float:
    """What of the region was left out because it failed when it was played, the pad did not touch it, or it
    is too hollow for the pad [m^2]."""
    of_pad = (PLAYED, UNPLAYED, SINKS_OFF, HOLLOW)
    return sum(row.area_m2 for reason, row in plan.area.left_out.items() if reason.startswith(of_pad))


def _pressed(plan: PlanResult) -> float:
    """What of the region is polished, by the share of the force it is polished with [m^2]."""
    eased = sum(mend.length_m * (1.0 - mend.share) for mend in plan.mends if mend.what == EASED)
    return plan.area.polished_m2 * (1.0 - eased / plan.path.length_along(plan.path.process))


class _Prover:
    """A plan on its way to its proof."""

    def __init__(self, scenario: Checked, plan: PlanResult, observer: Observer, work: Work) -> None:
        self.work = work
        scenario, _ = planned(scenario, plan)
        self.scenario = scenario
        self.place = prepare_surface(scenario, plan, observer)
        self.plan, self.path, self.observer = plan, plan.path, observer
        self.share = np.ones(len(plan.path.s))  #: Of the planned feed, by rows of the path
        self.pressed = np.ones(len(plan.path.s))  #: Of the force asked for, by rows of the path
        #: Feed an even removal keeps below where the path was slowed [m/s], by rows of the path
        self.most = np.full(len(plan.path.s), math.inf)
        self.easiest = EASIEST if scenario.plan.removal else EASIER  #: Share of the force, at least
        self.cut = False  #: Since the path was placed
        self.evened = 0  #: Mends the dwell of an even removal was found with
        self.mends: list[Mend] = []
        self.shares: dict[str, tuple[float, float]] = {}
        self.kept_until = 0.0
        self.failed_m = 0.0  #: Length that was left out since neither feed nor force helped [m]
        self._leave_out_what_sinks()

    def _leave_out_what_sinks(self) -> None:
        """Leave out where the pad would sink off an edge of a part that is displaced to the side.

        Raises:
            PlanError: It would everywhere.
        """
        path, scenario = self.path, self.scenario
        rows = np.flatnonzero(path.process)
        rows = rows[np.unique(path.s[rows] // LOOKED_M, return_index=True)[1]]
        places = path.positions_work[rows]
        force = path.force_at(path.s[rows], scenario.process.contact_force_n)
        extent = 0.5 * diagonal_of(places)
        aside = (
            scenario.part.displacement_m * math.sqrt(1.0 - NORMAL_SHARE**2)
            + scenario.part.rotation_rad * extent
        )
        fields, axes = self.place.fields(self.place.drawn, scenario), path.axes_work[rows]

        def sinking(share: float) -> Bools:
            """Rows in contact at which the pad would sink under a share of the force."""
            lost = would_sink(fields, scenario.pad, places, axes, share * force + CONTACT_N, aside)
            if not lost.any():
                return np.zeros(len(path.s), dtype=bool)
            near, _ = cKDTree(places[lost]).query(path.positions_work)
            return path.process & (near <= LOOKED_M)

        gone, share = sinking(1.0), 1.0
        while gone.any() and EASIER * share >= self.easiest:
            share *= EASIER
            eased = gone & ~sinking(share)
            if eased.any():
                self._ease(eased, SINKS_OFF, share)
            gone &= ~eased
        if gone.any():
            size = f"{2e3 * scenario.pad.radius_m:.3g} mm, under {force.max():.3g} N"
            self._leave_out(gone, f"{SINKS_OFF}: of {size}, {1e3 * aside:.2g} mm aside")

    def _keep(self, remaining: Remaining) -> None:
        """Continue with what is left of the path, from the joints the arm had there, tool x where it was: the
        strokes that stay are those played before. Where the arm cannot do that, another place is looked for,
        and all is played anew."""
        whole, reach, source = self.path, self.place.reach, remaining.source
        self.path, self.cut = remaining.path, True
        self.share, self.pressed, self.most = self.share[source], self.pressed[source], self.most[source]
        first = norms(whole.positions_work - self.path.positions_work[0]).argmin()
        try:
            for path, row in ((whole, first), (self.path, 0)):
                q = check_whole_path(reach, path.positions_work, path.axes_work).q
                reach = reach._replace(q_start=np.array(q[row]))
        except ReachError:
            self.kept_until = -math.inf
            reach = self._reach_of_run(self.scenario.part.pose)
        self.place = self.place.along(self.path, reach)

    def pass_drawn(self, first: int) -> Play | None:
        """Pass through on the part as drawn, and begin on that of the ``first`` seed in a thread meanwhile;
        None where a mend made that worthless."""
        self._prepare()
        other, mended = self._play(first), len(self.mends)
        with ThreadPoolExecutor(1) as thread:
            # A user's own controller may not stand two runs at once; a worker's siblings have the processors.
            alone = parent_process() is not None or not isinstance(other.cell.controller, CompiledController)
            meanwhile = None if alone else thread.submit(other.play_on, SILENT)
            try:
                self.pass_through(None)
            finally:
                other.wanted = sys.exception() is None and len(self.mends) == mended
        if self.mends:
            # The whole path is played at the end on a drawn part, which asks for more.
            self.shares.clear()
        if not meanwhile or not other.wanted:
            return None
        meanwhile.result()  # raises what it raised
        return other

    def settle(self, seed: int | None, begun: Play | None = None) -> None:
        """Play the path until it passes whole from its start: on the part as drawn, or as a seed draws it."""
        while True:
            if not begun:
                self._prepare()
            mended = len(self.mends)
            self.pass_through(seed, begun)
            begun = None
            if len(self.mends) == mended:
                return
            self.shares.clear()
            self._refuse_when_over(self.mends[-1].why)

    def _prepare(self) -> None:
        """Before the path is played from its start, keep it clear of the part. Where it was cut, take the
        configuration of the arm that a run takes, which looks for one anew in this pose, and sample the part
        along what is left."""
        wider = 1.0
        while not self._keeps_clear(wider):
            wider *= 2.0
        if self.cut:
            reach = self._reach_of_run(to_pose(self.place.reach.T_base_work))
            self.place, self.cut = replace(self.place, path=self.path, reach=reach), False

    def _refuse_when_over(self, why: str) -> None:
        """End with a PlanError where coming to an end has taken as long as may be."""
        if self.work.used > 1.5:
            raise PlanError(
                f"the plan could not be proven: after {self.work.done_s:.0f} s of the cell's time it still "
                f"fails because {why}. Set a lower --feed, another --contact-force, a smaller --pad-diameter "
                "or another --region; --proof none runs it all the same."
            )

    def _keeps_clear(self, wider: float) -> bool:
        """Find the dwell of an even removal, and leave out where the tool would stand in the part with its
        force, which is found after the path was planned, and as it is mended; whether it stands there
        nowhere.

        Raises:
            PlanError: As `out_of_part`.
        """
        self._even_out()
        # The rest of a path lands with less force on what its whole force was measured over.
        whole = self.path.force is None or self.scenario.plan.begin_m > 0.0
        as_planned = not self.mends and whole
        if as_planned or self.scenario.safety.tool_in_part != "refuse":
            return True
        ready = self.plan.ready
        quality = ready.measure(self.place_now().path)
        if not len(quality.pad_in_part.positions):
            return True
        remaining = out_of_part(ready, self.path, quality, wider)
        self.mends.append(mend_of(LEFT_OUT, IN_PART, 0.0, self.path, remaining.lost))
        self._keep(remaining)
        return False

    def _reach_of_run(self, pose: tuple[float, ...]) -> Reach:
        """How a run does the path as mended so far, the part at a pose (6,); raises as `PartPlacing`."""
        asked = replace(self.scenario, part=replace(self.scenario.part, pose=pose))
        return PartPlacing(asked, *self.plan.standing, self.path).reach()

    def pass_through(self, seed: int | None, begun: Play | None = None) -> None:
        """Play the path once from its start to its end, going back a little for every mend."""
        self.observer.stage(f"prove in the cell{'' if seed is None else f', part of seed {seed}'}")
        play, work = begun or self._play(seed), self.work
        found, before = play.play_on(self.observer) if begun is None else play.found, work.done_s
        while found:
            work.done_s, last = before + play.worked_s, found[0]
            whole = 1e3 * self.path.s[-1]
            self._refuse_when_over(f"{last.why}, from {1e3 * last.s:.0f} of {whole:.0f} mm of the path on")
            if work.used > 1.0 and play.margin:
                play.margin, self.kept_until = 0.0, math.inf
            else:
                self._mend(found)
            play.go_back(self.place_now(), self.kept_until)
            found = play.play_on(self.observer)
        self.play = play
        work.done_s = before + play.worked_s
        for name, kept in play.passing.items():
            self.shares[name] = max(kept, self.shares.get(name, kept))

    def _even_out(self) -> None:
        """Find the dwell of an even removal for the path as it is mended, its force as given; where it was
        slowed it stays slowed by that share. The rest of a path is not all that makes it even."""
        plan, asked = replace(self.plan, path=self.place_now().path), self.scenario.plan
        if not asked.removal or asked.begin_m or plan.path.feed is None or len(self.mends) == self.evened:
            return
        found = even_out(self.scenario, plan, self.observer, self.most)
        self.plan = replace(self.plan, figures=found.figures, notes=found.notes)
        feed = found.path.feeds(self.scenario.process.feed_m_s)
        self.path = replace(self.path, feed=feed / self.share)
        self.evened = len(self.mends)

    def _play(self, seed: int | None) -> Play:
        play = Play(self.scenario, seed, self.place_now())
        play.margin *= self.work.used <= 1.0
        return play

    def place_now(self) -> Workplace:
        """The place with the path as it is mended so far, on the same part and in the same pose."""
        path, process = self.path, self.scenario.process
        feed, force = path.feed, path.force
        if (self.share < 1.0).any():
            feed = self.share * path.feeds(process.feed_m_s)
        if (self.pressed < 1.0).any():
            force = np.maximum(self.pressed * path.force_at(path.s, process.contact_force_n), LEAST_FORCE_N)
        return self.place.along(replace(path, feed=feed, force=force), self.place.reach)

    def _row(self, failure: Failure) -> int:
        """Row of the path in contact that is nearest to a failure."""
        process = np.flatnonzero(self.path.process)
        return int(process[np.abs(self.path.s[process] - failure.s).argmin()])

    def _stroke_of(self, row: int) -> Bools:
        """Rows of the stroke a row is in."""
        first, last = next(pair for pair in stretches(self.path.process) if pair[0] <= row <= pair[1])
        rows = np.arange(len(self.path.s))
        return (rows >= first) & (rows <= last)

    def _mend(self, found: list[Failure]) -> None:
        """Slow the path where that may help, press with less where it does not, and leave out what neither
        helps; one mend for each cause.

        Raises:
            PlanError: Nothing is left to polish, or no path would help.
        """
        self.kept_until = math.inf
        groups: dict[tuple[str, float, str], tuple[str, Bools]] = {}
        failed = np.zeros(len(self.path.s), dtype=bool)
        for failure in found:
            what, share, rows = self._remedy(failure)
            if what == LEFT_OUT and failure.code in FORCE_FAILS:
                failed |= rows
            key = what, share, failure.why.partition(":")[0]
            why, before = groups.get(key, (failure.why, rows))
            groups[key] = why, rows | before
        self._refuse_when_it_fails_everywhere(failed, found[-1].why)
        kept = np.arange(len(self.path.s))  # rows of the path as it was played
        for (what, share, _), (why, rows) in groups.items():
            rows = rows[kept] & self.path.process
            if not rows.any():
                continue
            if what == LEFT_OUT:
                kept = kept[self._leave_out(rows, PLAYED + why)]
            else:
                (self._slow if what == SLOWED else self._ease)(rows, why, share)

    def _refuse_when_it_fails_everywhere(self, failed: Bools, why: str) -> None:
        """End with a PlanError where most of the path fails at any feed and force; ``failed`` are further
        rows."""
        self.failed_m += self.path.length_along(failed)
        share = self.failed_m / self.plan.path.length_along(self.plan.path.process)
        if share > MOST_FAILED:
            raise _Hopeless(
                f"played in the cell, {share:.0%} of the path fails at any feed and with less force: {why}. "
                "Set another --contact-force, --controller or, where noise or drift of the sensor is the "
                "cause, sensor.model; --proof none plans it all the same."
            )

    def _remedy(self, failure: Failure) -> tuple[str, float, Bools]:
        """What is changed because of a failure: to which share of feed or force, and in which rows.

        Raises:
            PlanError: No other path would help.
        """
        path = self.path
        s = path.s
        row = self._row(failure)
        pad = self.scenario.pad.radius_m
        code, pressed, slower = failure.code, float(self.pressed[row]), SLOWER * float(self.share[row])
        if code in HOPELESS:
            raise _Hopeless(f"played in the cell the plan fails at {self._where(row)}: {failure.why}.")
        what, share, reach = LEFT_OUT, 0.0, 0.5 * pad
        less = EASIER if pressed > EASIER else self.easiest
        usual = path.force_at(s, self.scenario.process.contact_force_n)[row]
        if code in FORCE_FAILS and not failure.landing and slower >= SLOWEST:
            what, share = SLOWED, slower
            reach = max(AROUND_S * self._feed_at(row), AROUND_M)
        elif (
            pressed > self.easiest
            and code in (*FORCE_FAILS, guard.FALLEN, guard.DEEP)
            and less * usual > CONTACT_N + failure.off  # else less force would lose contact: it is off as far
        ):
            what, share, reach = EASED, less, pad
        else:
            # The cuts of a neighbouring line are another place.
            reach *= 2.0 ** sum(
                norms(mend.places - path.positions_work[row]).min() < 0.5 * self.plan.plan.stepover_m
                for mend in self.mends
                if mend.what == LEFT_OUT
            )
        rows = self._stroke_of(row) & (np.abs(s - s[row]) <= reach)
        if what == SLOWED and sum(mend.what == SLOWED for mend in self.mends) >= MOST_SLOWED:
            # It fails everywhere: the rest of the path is slowed at once.
            rows = path.process & (s >= s[rows].min())
        return what, share, rows

    def _feed_at(self, row: int) -> float:
        return float(self.share[row]) * self.scenario.process.feed_m_s

    def _ease(self, rows: Bools, why: str, share: float) -> None:
        """Press with a share of the force along some rows of the path; it comes down before and rises behind
        them."""
        path, s = self.path, self.path.s
        ramp = max(AROUND_S * self.scenario.process.feed_m_s, AROUND_M)
        away, _ = cKDTree(s[rows, None]).query(s[:, None])
        self.pressed = np.minimum(self.pressed, np.clip(share + (1.0 - share) * away / ramp, share, 1.0))
        self.kept_until = min(self.kept_until, s[rows].min() - 2.0 * ramp)
        self.mends.append(mend_of(EASED, why, share, path, rows))

    def _slow(self, rows: Bools, why: str, share: float) -> None:
        """Feed the tool at a share of the planned feed along some rows of the path."""
        path, first = self.path, int(rows.argmax())
        self.kept_until = min(self.kept_until, path.s[first] - SLOWING_S * self._feed_at(first))
        slower = rows & (self.share > share)
        self.share[slower] = share
        if path.feed is not None:
            self.most[slower] = share * path.feed[slower]
        self.mends.append(mend_of(SLOWED, why, share, path, rows))

    def _leave_out(self, rows: Bools, why: str) -> Indices:
        """Lift the tool over some rows of the path; the rows that are kept. Raises as `_mend`."""
        path, first = self.path, int(rows.argmax())
        remaining = lift_over(path, rows, self.plan.plan, self.plan.ready.air)
        if remaining is None:
            raise PlanError(
                f"nothing of the path can be polished, the last place at {self._where(first)}: {why}. Set a "
                "smaller --pad-diameter, a lower --contact-force or another --region."
            )
        lost = remaining.lost
        self.mends.append(mend_of(LEFT_OUT, why.partition(":")[0], 0.0, path, lost))
        self.kept_until = min(self.kept_until, path.s[lost].min() - SLOWING_S * self._feed_at(first))
        self._keep(remaining)
        return remaining.source

    def _where(self, row: int) -> str:
        return f"{place_in_mm(self.path.positions_work[row])} of the part"

    def result(self) -> Proven:
        """The plan as it passed, and the scenario it runs in: its part stands where it stood here."""
        place, scenario, plan = self.place_now(), self.scenario, self.plan
        reach = place.reach
        pose = to_pose(reach.T_base_work)
        made = {mend.what for mend in self.mends}
        cuts = [cut for cut in plan.cuts if cut.reason != UNPLAYED]  # that is of an earlier proof
        changed = made or len(cuts) < len(plan.cuts)
        if not scenario.process.max_feed_s:  # else most of the path was not played
            self.observer.stage("measure the removal")
            removal, asked = self.play.removal(), plan.ready.asked
            nearest = cKDTree(removal.vertices).query(asked.ground.mesh.vertices)[1]
            bare = (removal.exposure[nearest] <= 0.0) & (asked.why < 0)
            if bare.any():
                cuts.append(CutOut(UNPLAYED, asked.ground.mesh.vertices[bare]))
                changed = True
        if changed:
            plan = replace(plan, cuts=tuple(cuts)).along(place.path, self.mends)
        if LEFT_OUT in made:
            # Of another path another place might be chosen.
            scenario = replace(scenario, part=replace(scenario.part, pose=pose))
        whole = self.plan.path
        proof = {
            "arm": scenario.robot.arm, "controller": scenario.controller.label,
            "feed_m_s": whole.feeds(scenario.process.feed_m_s)[whole.process].max(),
            "contact_force_n": whole.largest_force(scenario.process.contact_force_n),
            "seed": scenario.seed, "proof": scenario.safety.proof,
            "settings": config_hash(proof_settings(scenario), {}), "path": path_key(place.path),
            "changed": changed_words(proof_settings(scenario), proof_settings(default_scenario("surface"))),
            "slowed": SLOWED in made, "eased": EASED in made, "pose": pose,
            "work_used": self.work.used,
            "limits": {name: {"share": share, "at_m": at} for name, (share, at) in self.shares.items()},
            "mends": [
                {**mend._asdict(), "places": None, "at_m": mend.places[0].tolist()} for mend in plan.mends
            ],
        }  # fmt: skip
        figures = {
            **plan.figures,
            "T_base_work": reach.T_base_work.tolist(),
            "smallest_singular_value": reach.smallest_singular_value,
            "proven": 1,
            "proof_work_s": self.work.done_s,
        }
        notes = (*plan.notes, *proof_notes(proof), *drift_notes(scenario.process, scenario.sensor, plan))
        plan = replace(plan, path=place.path, proof=proof, figures=figures, notes=notes)
        kept_place(scenario, lambda: place, plan)
        return Proven(plan, scenario)
