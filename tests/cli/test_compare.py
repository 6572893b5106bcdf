"""`polish-sim compare` writes figures, a picture and a page, and refuses what would change nothing."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from polish_sim.motion.makes import use_arm
from tests.exchange.robot_logs import synthetic_log, write_csv


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Slow sines of all joints, with torques."""
    made = synthetic_log(3.0)
    made["q_rad"] = 0.3 * made["q_rad"] + [0.3, -1.4, 1.2, -1.0, -1.2, 0.2]
    return write_csv(tmp_path_factory.mktemp("log") / "log.csv", made | {"qd_rad_s": 0.3 * made["qd_rad_s"]})


@pytest.fixture(autouse=True)
def _back_to_the_first():
    yield
    use_arm("ur5e")


@pytest.mark.pictures
def test_the_command_writes_figures_picture_and_page(
    log: Path, polish_sim: Callable[..., Any], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    code, said, _ = polish_sim("compare", log, "--arm", "ur10e", "--payload", 2, "--out", out)
    assert code == 0
    assert "ur10e" in said
    figures = json.loads((out / "compare.json").read_text())
    assert {"nrms", "delay_s", "ripple_cycles"} <= set(figures)
    assert len(figures["nrms"]) == 6
    assert {"compare.png", "report.html", "config.toml"} <= {path.name for path in out.iterdir()}


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["--set", "sensor.model=axia80"], "robot.KEY"),
        (["--payload-center", "1,2"], "X,Y,Z"),
        (["--arm", "ur20"], "ur10e"),
        (["--asked", 20], "--beside"),
        (["--beside", "nowhere"], "nowhere"),
        (["--to", 0.0001], "fewer than two"),
    ],
)
def test_what_cannot_be_done_is_one_message(
    log: Path, polish_sim: Callable[..., Any], tmp_path: Path, words: list[object], what: str
) -> None:
    code, _, error = polish_sim("compare", log, *words, "--out", tmp_path / "out")
    assert code == 2
    assert what in error
    assert not (tmp_path / "out").exists()
