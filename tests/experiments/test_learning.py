"""`--learn`: what one run found along the path is fed forward in the next."""

from pathlib import Path

import numpy as np
import pytest

from polish_sim.analysis.run_record import RunRecord, read_record, write_record
from polish_sim.config import Scenario
from polish_sim.errors import InputError
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.experiments.assembly import check_settings
from polish_sim.scenario_file import override

SHORT = (
    "part.file=saddle", "plan.stepover_m=0.03", "plan.edge_margin_m=0.05", "process.feed_m_s=0.03",
    "process.max_feed_s=8", "seed=931",
)  # fmt: skip


def scenario(*changes: str) -> Scenario:
    return override(default_scenario("surface"), [*SHORT, *changes])


def kept(folder: Path, asked: Scenario) -> Path:
    folder.mkdir()
    run = run_experiment(asked)
    write_record(folder, RunRecord(folder.name, run.scenario, run.figures, run.log, run.path))
    return folder


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return kept(tmp_path_factory.mktemp("passes") / "first", scenario())


def test_the_second_pass_errs_less_than_the_first_with_another_noise(first, tmp_path):
    before = read_record(first)
    second = read_record(kept(tmp_path / "second", scenario(f"process.learn={first}")))
    assert second.metrics["learned_from"] == 1
    assert second.metrics["force_rms_error_n"] < 0.8 * before.metrics["force_rms_error_n"]
    # The part lies as it lay: the tool lands at the same height. The sensor's noise is not the same.
    landed = [record.log["tcp_position_m"][record.log.fed][0] for record in (before, second)]
    assert np.linalg.norm(landed[0] - landed[1]) < 3e-4
    air = [record.log["wrench_raw_sensor"][:100, 2] for record in (before, second)]
    reading = [record.log["wrench_measured_tool"][:100, 2] for record in (before, second)]
    assert np.allclose(air[0], air[1], atol=0.1)
    assert abs(np.corrcoef(*reading)[0, 1]) < 0.5
    third = run_experiment(scenario(f"process.learn={tmp_path / 'second'}"))
    assert third.figures["learned_from"] == 2


@pytest.mark.parametrize(
    ("by", "change", "named"),
    [
        (run_experiment, "seed=932", "seed"),
        (run_experiment, "process.contact_force_n=15", "process.contact_force_n"),
        (run_experiment, "plan.stepover_m=0.04", "the path"),
        (run_experiment, "part.displacement_m=0.002", "part.displacement_m"),
        (run_experiment, "part.pose=[0,-0.55,0.08,0,0,0]", "where the part stands"),
        (check_settings, "controller.name=hybrid-adaptive", "hybrid-adaptive"),
        (check_settings, "process.learn=nowhere", "not a run folder"),
        (check_settings, "experiment=arc", "run surface"),
    ],
)
def test_another_job_is_refused_by_what_differs_and_what_cannot_learn_at_once(first, by, change, named):
    with pytest.raises(InputError, match=named):
        by(scenario(f"process.learn={first}", change))
