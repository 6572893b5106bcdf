"""report.html in a real browser: it plays back the log, needs no network, and shows what the run was."""

import itertools
import shlex
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pytest

from polish_sim.analysis.run_record import RunRecord
from polish_sim.cell import Silent, tool_on_flange
from polish_sim.errors import InputError
from polish_sim.exchange import ExportSetup
from polish_sim.exchange.viewers import html_text
from polish_sim.experiments.registry import default_scenario, once_more, run_experiment
from polish_sim.experiments.report import page_of, runs_table, saved_page, seeds_page
from polish_sim.experiments.run_page import clock, run_page
from polish_sim.log import RunLog
from polish_sim.motion import forward
from polish_sim.page import PAGE, Table, save_page
from polish_sim.page.page import Page, page_html, read_page
from polish_sim.row_file import read_json
from polish_sim.scenario_file import merge, override
from polish_sim.scoring import BATTERY, user_entry
from polish_sim.spatial import apply, inverse
from tests.cli.conftest import UNPROVEN, done, in_browser
from tests.planning.shapes import shipped_plan

LARGEST = 4_000_000
HOSTILE = "</script><script>document.title='taken'</script><b>&amp;@DATA@"
SHORT_PATH = "plan.stepover_m=0.03", "process.feed_m_s=0.06", "part.file=sphere_100"
HARDER = "process.contact_force_n=26", "seed=1"


class Made(NamedTuple):
    """A run and its scene."""

    record: RunRecord
    model: Any


class Keep(Silent):
    """Keeps the model of the cell."""

    def frame(self, model, data):
        self.model = model


@cache
def made(experiment, *changes):
    keep = Keep()
    result = run_experiment(override(default_scenario(experiment), changes), None, keep)
    figures = {**result.figures, "versions": {"numpy": np.__version__}}
    made = RunRecord(experiment, result.scenario, figures, result.log, result.path, result.removal)
    return Made(made, keep.model)


class Tab(NamedTuple):
    """A page that was opened, and what it has done since."""

    tab: Any
    requests: list[str]
    errors: list[str]
    size: int

    def __call__(self, script, argument=None):
        return self.tab.evaluate(script, argument)

    def seek(self, time):
        """Move the scrubber as a hand does; the picture then, shape (48, 64, 3)."""
        scrubber = "const s = document.getElementById('scrubber')"
        self(f"t => {{ {scrubber}; s.value = t; s.dispatchEvent(new Event('input')); }}", time)
        return self.picture()

    def picture(self):
        """What the canvas shows, shape (48, 64, 3)."""
        pixels = self(
            """() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
              const canvas = Object.assign(document.createElement("canvas"), { width: 64, height: 48 });
              const pen = canvas.getContext("2d");
              pen.drawImage(document.getElementById("scene"), 0, 0, 64, 48);
              done(Array.from(pen.getImageData(0, 0, 64, 48).data)); })))"""
        )
        return np.array(pixels, dtype=float).reshape(48, 64, 4)[:, :, :3]


@pytest.fixture(scope="module")
def opened(browser, tmp_path_factory):
    """Open a page, or that of a run, from its file, on a screen as large as one likes."""
    contexts = []

    def open_page(shown, width=900, notes=()):
        folder = tmp_path_factory.mktemp("page")
        if isinstance(shown, str):
            (folder / PAGE).write_text(shown, encoding="utf-8")
        else:
            save_page(folder, page_of(shown.record, shown.model, notes))
        contexts.append(browser.new_context(viewport={"width": width, "height": 700}))
        tab, requests, errors = contexts[-1].new_page(), [], []
        tab.on("request", lambda request: requests.append(request.url))
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        tab.goto((folder / PAGE).as_uri())
        end = time.monotonic() + 30  # asked from outside: inside it would need `eval`, which the page forbids
        while not tab.evaluate("Boolean(window.page && window.page.data.ready)"):
            assert time.monotonic() < end, "the page is not ready after 30 s"
            time.sleep(0.01)
        return Tab(tab, requests, errors, (folder / PAGE).stat().st_size)

    yield open_page
    for context in contexts:
        context.close()


def assert_clean(tab):
    """One request, the file itself; no error."""
    assert [url.partition(":")[0] for url in tab.requests] == ["file"]
    assert tab.errors == []
    assert tab.size < LARGEST


def assert_follows_the_log(tab, run, arms):
    """Joints as in every row of the log; the head where the log says the tool is."""
    log = run.record.log
    time = log["time_s"]
    joints = np.array(tab("times => times.map((t) => window.page.joints(t))", time.tolist()))
    first = {str(run.model.joint(k).name): int(run.model.jnt_qposadr[k]) for k in range(run.model.njnt)}
    for column, start in zip(arms, ("shoulder_pan_joint", "master_shoulder_pan_joint"), strict=False):
        at = next(place for name, place in first.items() if name.removeprefix("follower_") == start)
        assert np.abs(joints[:, at : at + 6] - log[column]).max() < 3e-4
    rows = np.linspace(0, len(log) - 1, 60).astype(int)
    head = next(k - 1 for k in range(run.model.nbody) if str(run.model.body(k).name).endswith("head"))
    script = "([times, k]) => times.map((t) => Array.from(window.page.bodies(t)[k]))"
    poses = np.array(tab(script, [time[rows].tolist(), head])).reshape(-1, 3, 4)
    tip = poses[:, :, 3] + log["pad_travel_m"][rows, None] * poses[:, :, 2]
    assert np.linalg.norm(tip - log["tcp_position_m"][rows], axis=1).max() < 2e-4


@in_browser
def test_a_page_plays_the_run_back_colours_what_was_removed_and_goes_to_where_one_clicks(opened):
    surface = made("surface", *SHORT_PATH)
    scenario = merge(surface.record.scenario, {"part": {"file": HOSTILE}}, "")
    figures = {**surface.record.metrics, "protective_stop": HOSTILE}
    record = replace(surface.record, scenario=scenario, metrics=figures)
    played = opened(surface._replace(record=record), notes=(HOSTILE,))
    assert played("document.title") != "taken"
    assert played("document.body.innerText").count(HOSTILE) >= 3
    assert played("document.querySelectorAll(':not(figcaption) > b').length") == 0
    assert_follows_the_log(played, surface, ("q_rad",))
    assert_clean(played)
    log, removal = surface.record.log, surface.record.removal

    def removed(time):
        return np.array(played("t => window.page.removal(t)", time))

    time, total = log["time_s"], log["exposure_nm"]
    assert np.abs(removed(time[-1]) - removal.relative).max() < 0.01
    # Before the end the log knows the sum over the part.
    for share in (0.25, 0.5, 0.75):
        grown = removal.areas @ removed(float(np.interp(share * total[-1], total, time)))
        assert grown / (removal.areas @ removal.relative) == pytest.approx(share, abs=0.02)
    assert removed(0.0).max() == 0.0
    tab, end, first = played, float(time[-1]), played.tab.locator("figure canvas").first
    first.scroll_into_view_if_needed()
    box = first.bounding_box()
    tab.tab.mouse.click(box["x"] + 46 + 0.5 * (box["width"] - 54), box["y"] + 30)
    assert tab("window.page.now()") == pytest.approx(0.5 * end, rel=0.01)
    tab.tab.keyboard.press("Home")
    assert tab("window.page.now()") == 0.0
    tab("window.page.look('part')")
    tab.seek(end)
    view = tab.tab.locator("#scene").bounding_box()
    tab.tab.mouse.click(view["x"] + 0.5 * view["width"], view["y"] + 0.62 * view["height"])
    moment = tab("window.page.now()")
    assert 0.0 < moment < end
    assert np.interp(moment, time, log["normal_force_n"]) > 10.0  # there the pad was on the part
    for ends in ([-25.0, 45.0], [0.0, 25.0], [-1e-3, 1.9], [-3.9, 3.9], [12.1, 12.3]):
        assert 2 <= len(tab("ends => ticks(...ends, 3)", ends)) <= 7


@in_browser
def test_two_robots_move_and_the_part_moves_with_the_second(opened):
    two_robots = made("dual", "process.feed_m_s=0.06", "process.max_feed_s=2", "dual.master_speed_m_s=0.01")
    tab, record = opened(two_robots), two_robots.record
    assert_follows_the_log(tab, two_robots, ("q_rad", "master_q_rad"))
    assert_clean(tab)
    pad = np.array(tab("Array.from(window.page.data.padOnPart)")).reshape(-1, 3)
    pressing = np.array(tab("Array.from(window.page.data.motion.force)")) > 10.0
    near = record.path.positions_work[record.path.process]
    apart = np.linalg.norm(pad[pressing, None] - near[None], axis=2).min(axis=1)
    assert apart.max() < 3e-3  # the real part sits up to a millimetre off and is pressed
    part = "Array.from(window.page.bodies(t)[window.page.data.part_body])"
    first, last = np.array(tab(f"[0, 1e9].map((t) => {part})"))
    assert np.abs(last - first).max() > 0.01


@in_browser
def test_a_stopped_run_says_why_and_a_run_of_one_row_opens(opened):
    stopped = made("force", "faults.events=sensor-dropout@contact+0.3")
    tab = opened(stopped)
    assert "protective stop" in tab.tab.locator("#stop").inner_text()
    assert_clean(tab)
    columns = {name: column[:1] for name, column in stopped.record.log.columns.items()}
    one = Made(replace(stopped.record, log=RunLog(MappingProxyType(columns)), removal=None), stopped.model)
    tab = opened(one, width=390)
    assert tab.picture().std() > 10.0
    assert tab("document.documentElement.scrollWidth") <= 390
    assert_clean(tab)


@in_browser
def test_a_plan_plays_its_path_and_predicts_the_removal(opened):
    plan = shipped_plan("sphere_100")
    tab = opened(html_text(replace(plan, mesh=replace(plan.mesh, name=HOSTILE)), ExportSetup()))
    end = tab("window.page.now()")
    assert HOSTILE in tab("document.querySelector('h1').innerText")
    seen = [(tab.seek(share * end), tab("window.page.cursor()")) for share in (0.2, 0.5, 0.8)]
    for (picture, cursor), (later, after) in itertools.pairwise(seen):
        assert np.abs(later - picture).max() > 20.0
        assert after > cursor + 20.0
    # Force and feed are the same all along: half of it is done in half of the time.
    sums = [sum(tab("t => window.page.removal(t)", share * end)) for share in (0.0, 0.5, 1.0)]
    assert sums[0] == 0.0
    assert sums[1] / sums[2] == pytest.approx(0.5, abs=0.03)
    assert_clean(tab)


@in_browser
def test_two_runs_lie_over_each_other(opened, tmp_path):
    surface, harder = (made("surface", *SHORT_PATH, *other) for other in ((), HARDER))
    runs = [surface.record, replace(harder.record, name="harder")]
    for name, run in zip(("a", "b"), (surface, harder), strict=True):
        (tmp_path / name).mkdir()
        save_page(tmp_path / name, page_of(run.record, run.model))
    (tmp_path / "both").mkdir()
    save_page(tmp_path / "both", saved_page([tmp_path / "a", tmp_path / "b"], runs))
    tab = opened((tmp_path / "both" / PAGE).read_text(encoding="utf-8"))
    first, second = (run.removal for run in runs)
    tab.tab.locator("#layers select").first.select_option("minus:0")
    tab.picture()
    drawn = np.array(tab("Array.from(window.page.data.colored)"))
    assert drawn == pytest.approx(second.relative - first.relative, abs=0.02)
    captions = tab.tab.locator("figcaption").first.inner_text()
    assert "surface" in captions
    assert "harder" in captions
    assert_clean(tab)


@in_browser
def test_a_page_of_tables_alone_opens_at_any_width(opened):
    cases = Table("Cases", ["case", "error"], [[f"  case-{k}", f"{k} {HOSTILE}"] for k in range(30)])
    tab = opened(page_html(Page.of("score", "thirty cases", [cases], ["a note"])), width=390)
    assert tab("document.querySelectorAll('td').length") == 60
    assert not tab.tab.locator("#stage").is_visible()
    assert tab("document.documentElement.scrollWidth") <= 390
    assert_clean(tab)


def test_the_command_of_a_case_runs_its_very_scenario():
    for case in BATTERY:
        scenario, usual = case.scenario(user_entry("hybrid-adaptive"), 3), default_scenario(case.experiment)
        words = shlex.split(once_more(scenario))
        assert words[:3] == ["polish-sim", "run", case.experiment]
        assert override(usual, words[4::2]) == scenario


def test_a_page_is_read_back_as_written_and_many_seeds_have_bands(tmp_path):
    surface, harder = (made("surface", *SHORT_PATH, *other) for other in ((), HARDER))
    save_page(tmp_path, page_of(surface.record, surface.model))
    page = read_page(tmp_path / PAGE)
    log, removal = surface.record.log, surface.record.removal
    assert page.wear.value == pytest.approx(removal.relative, abs=1e-4)
    assert (page.wear.faces == removal.triangles).all()
    assert page.motion.time[[0, -1]] == pytest.approx(log["time_s"][[0, -1]])
    assert np.isnan(page.motion.asked[0])
    (tmp_path / PAGE).write_text("no page")
    with pytest.raises(InputError, match="cannot read the page"):
        read_page(tmp_path / PAGE)
    # Moves that each begin at zero follow each other.
    twice = {name: np.concatenate([column[:50]] * 2) for name, column in log.columns.items()}
    time = clock(RunLog(MappingProxyType(twice)))
    assert (np.diff(time) > 0.0).all()
    assert time[-1] == pytest.approx(99 * (time[1] - time[0]))
    record = surface.record
    missed = replace(record, metrics={**record.metrics, "faults_missed": ["a@9"]})
    notes = run_page(missed, surface.model).notes
    assert any(note.startswith("a@9 did not happen") for note in notes)
    records = [surface.record, harder.record]
    page = seeds_page(records, runs_table(records), ["a note"])
    assert page.notes == ["a note"]
    force = next(line for line in page.plots[0].lines if line.label == "exact force")
    assert (force.low <= force.values + 1e-9).all()
    assert (force.high >= force.values - 1e-9).all()
    assert np.median((force.high - force.low)[np.isfinite(page.motion.asked)]) == pytest.approx(6.0, abs=0.5)


def test_a_plan_s_page_shows_the_robot_for_as_long_as_the_cycle_takes(polish_sim):
    words = ["plan", "sphere_100", "--stepover", "40", "--feed", "40", "--out", "plan"]
    assert "plan/report.html" in done(polish_sim(*words, *UNPROVEN)).out
    page, figures = read_page(Path("plan", PAGE)), read_json(Path("plan", "metrics.json"))
    motion, pressing = page.motion, page.motion.force > 0.0
    assert motion.time[-1] == pytest.approx(figures["cycle_time_s"], abs=1e-3)
    assert (np.diff(motion.time) > 0.0).all()
    tips = forward(motion.joints[:, :6]) @ tool_on_flange()
    pads = tips[:, :3, 3] - motion.joints[:, 6:] * tips[:, :3, 2]
    assert np.linalg.norm(pads - motion.pad, axis=1).max() < 3e-4
    on_part = apply(inverse(np.array(figures["T_base_work"])), motion.pad[pressing])
    apart = np.linalg.norm(on_part[:, None] - page.path[None], axis=2).min(axis=1)
    assert apart.max() < 1.5e-3  # path points lie apart
