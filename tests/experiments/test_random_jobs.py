"""Random faults and jobs as benchmarks draw them, and what judges an answer."""

import json

import numpy as np
import pytest

from benchmarks.commands import Call
from benchmarks.drawn_jobs import inspect_faults, run_faults
from benchmarks.faults import DRAWN, RUNS, draw
from benchmarks.random_bodies import BODIES
from benchmarks.random_jobs import draw_job
from polish_sim.cell import FAULTS


def test_every_fault_is_drawn_about_as_often():
    drawn = draw(200)
    assert set(DRAWN) == set(FAULTS)
    for name in DRAWN:
        assert abs(sum(one.fault == name for one in drawn) - 200 / len(DRAWN)) <= 1
    assert {one.experiment for one in drawn} == set(RUNS)
    assert draw(200) == drawn


AREAS = {"region_area_m2": 2.0, "polished_area_m2": 1.5, "left_out_area_m2": 0.5}
GOOD = {**AREAS, "left_out": {"at an edge": 0.5}}
MEASURED = {"coverage_stepover": 0.9, "path_length_m": 1.0, "stepover_p5_m": 0.01, "self_crossings": 0}
PLANNED = {"notes": ["read in mm"], "coverage": 0.75, **MEASURED, **GOOD}


def answer(folder, code, text, figures):
    folder.mkdir(exist_ok=True)
    (folder / "metrics.json").write_text(json.dumps(figures))
    return Call(folder, code, text, 1.0)


def test_a_seed_draws_the_same_job_again_another_seed_another_and_every_body_is_a_part(tmp_path):
    one, again, other = (draw_job(seed, [], tmp_path) for seed in (20600, 20600, 20601))
    for name in ("name", "region", "planned", "cell"):
        assert getattr(one, name) == getattr(again, name)
    assert np.array_equal(one.mesh.triangles, again.mesh.triangles)
    assert one.planned != other.planned
    for name, body in BODIES.items():
        mesh = body(np.random.default_rng(5))
        assert (mesh.is_watertight, mesh.area > 0.0) == (name != "open scan", True), name


@pytest.mark.parametrize(
    ("code", "text", "figures", "fault"),
    [
        (0, "fine", {}, ""), (70, "Traceback", {}, "exit 70"),
        (0, "mean  nan N", {}, "no number: mean  nan N"),
        (0, "", {"peak_force_n": np.inf}, "no number: .peak_force_n"),
        (0, "", {"polished_area_m2": 1.6}, "areas: "), (0, "", {"contact_lost_s": 0.02}, "contact lost"),
        (3, "", {"protective_stop": "torque"}, "stopped: torque"),
        (1, " tangential error, max  mm  0.7  -  <= 0.65  NO ", {}, "its plan did not say: tangential error"),
        (1, "bad: 1 of 9 cm^2 are left out.", {}, "its plan did not say: bad"),
        (1, "", {}, "exit 1 without a reason"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_run_is_found_and_nothing_else(tmp_path, code, text, figures, fault):
    plan = answer(tmp_path / "plan", 0, "", PLANNED)
    found = list(run_faults(answer(tmp_path / "run", code, text, {**GOOD, **figures}), plan))
    assert len(found) == bool(fault)
    assert all(fault in line for line in found)


def test_a_run_may_fall_short_where_its_plan_says_so_other_figures_by_inspect_are_faults(tmp_path):
    notes = ["on other arms and parts this may fail run --check: tangential error"]
    plan = answer(tmp_path / "plan", 0, "bad: 1 of 9 cm^2 are left out.", {**PLANNED, "notes": notes})
    text = "bad: 1 of 9 cm^2 are left out.\n tangential error, max  mm  0.7  -  <= 0.65    NO"
    assert not list(run_faults(answer(tmp_path / "run", 1, text, GOOD), plan))
    plan = answer(tmp_path / "plan", 0, "", PLANNED)
    assert not list(inspect_faults(answer(tmp_path / "same", 0, "", PLANNED), plan))
    (fault,) = inspect_faults(answer(tmp_path / "other", 0, "", {**PLANNED, "path_length_m": 1.1}), plan)
    assert "path_length_m 1.1" in fault
