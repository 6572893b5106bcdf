"""Files written by commit 8ef5763, before the packages moved, are still read."""

import shutil
from pathlib import Path

import pytest

from polish_sim.exchange import read_path
from polish_sim.experiments import default_scenario
from polish_sim.log import read_log
from polish_sim.scenario_file import load_scenario, to_toml
from tests.cli.conftest import done

RIGID = ("--set", "robot.arm=ideal")  # quicker to place two robots with
OLD = Path(__file__).resolve().parent.parent / "files_of_8ef5763"


def test_a_config_gives_the_same_settings_when_written_again(tmp_path):
    for name, experiment in (("config_surface", "surface"), ("config_dual", "dual"), ("run/config", "force")):
        defaults = default_scenario(experiment)
        scenario = load_scenario(OLD / f"{name}.toml", defaults)
        assert scenario.robot.arm == "ideal"
        (tmp_path / "again.toml").write_text(to_toml(scenario), encoding="utf-8")
        assert load_scenario(tmp_path / "again.toml", defaults) == scenario


@pytest.mark.pictures
def test_plan_run_and_calibrations_are_read_and_drawn_again(polish_sim):
    table, document = read_path(OLD / "plan" / "path.csv"), read_path(OLD / "plan" / "path.json")
    assert len(table.s) == len(document.s) > 100
    assert abs(table.positions_work - document.positions_work).max() < 1e-9
    folder = Path("run")
    shutil.copytree(OLD / "run", folder)
    assert len(read_log(folder / "log.npz")) > 10
    done(polish_sim("report", folder, "--out", "report"))
    assert Path("report/force.png").stat().st_size > 10_000
    for experiment, names in (("force", ["payload"]), ("dual", ["tcp", "base"]), ("dual", ["arm"])):
        calibrations = [word for name in names for word in ("--calibration", OLD / f"{name}.toml")]
        done(polish_sim("run", experiment, *calibrations, *RIGID, "--dry-run"))
