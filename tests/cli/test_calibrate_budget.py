"""`polish-sim calibrate budget` as a user calls it."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from polish_sim.dual.budget import PairBudgetTrial, draw_errors
from tests.cli.conftest import metrics_of, undrawn


@pytest.fixture
def one_design(monkeypatch: pytest.MonkeyPatch) -> None:
    """Predict with one design of the calibrations instead of ten."""
    monkeypatch.setattr("polish_sim.dual.budget.DESIGNS", 1)


@pytest.mark.pictures
@pytest.mark.usefixtures("one_design")
def test_a_budget_leaves_its_files_meets_what_is_asked_and_draws_only_what_is_missing(
    polish_sim, tmp_path, monkeypatch
):
    words = ("calibrate", "budget", "--on", "here", "--check", "--out", "one")
    call = polish_sim(*words, "--draws", "30")
    assert call.code == 0
    assert "30 draws" in call.err
    files = {"metrics.json", "budget.png", "rows.jsonl", "asked.json"}
    assert {path.name for path in (tmp_path / "one").iterdir()} == files
    figures = metrics_of(tmp_path / "one")
    sources = figures["sources"]
    assert set(sources) == {"bases", "tool", "part", "closing", "together"}
    alone = [sources[name]["predicted_rms_m"] for name in ("bases", "tool", "part", "closing")]
    assert sources["together"]["predicted_rms_m"] == pytest.approx(np.linalg.norm(alone))
    assert figures["relative_error_rms_m"] == sources["together"]["drawn_rms_m"]
    assert figures["settings"]["tracker_noise_m"] == 3e-5
    numbers: list[int] = []

    def drawn(trial: PairBudgetTrial, number: int) -> dict[str, Any]:
        numbers.append(number)
        return draw_errors(trial, number)

    monkeypatch.setattr("polish_sim.dual.budget.draw_errors", drawn)
    with undrawn():
        assert polish_sim(*words, "--draws", "30").code == 0
        assert metrics_of(tmp_path / "one") == figures
        assert polish_sim(*words, "--draws", "32").code == 0
    assert numbers == [30, 31]
    assert "another calibrate-budget" in polish_sim(*words, "--draws", "32", "--seed", "1").err


def drawn_cheaply(trial: PairBudgetTrial, number: int) -> dict[str, Any]:
    """A draw as large as one real draw: a calibration each would take most of the time."""
    scale = np.random.default_rng(number).standard_normal()
    return {name: scale * errors for name, errors in _one_draw(trial).items()}


@cache
def _one_draw(trial: PairBudgetTrial) -> dict[str, Any]:
    return draw_errors(trial, 0)


@pytest.mark.usefixtures("one_design")
def test_worse_instruments_fall_short(polish_sim, tmp_path, monkeypatch):
    monkeypatch.setattr("polish_sim.dual.budget.draw_errors", drawn_cheaply)
    words = "calibrate budget --draws 30 --tracker-noise 0 --touch-noise 0.2 --marks 4 --closing 0"
    assert polish_sim(*words.split(), "--on", "here", "--check", "--out", "bad").code == 1
    figures = metrics_of(tmp_path / "bad")
    assert figures["settings"]["marks"] == 4
    assert figures["settings"]["closing_touches"] == 0
    assert figures["sources"]["tool"]["predicted_rms_m"] == pytest.approx(2e-4 * np.sqrt(0.4), rel=1e-6)
    assert figures["sources"]["bases"]["predicted_rms_m"] == 0.0


@pytest.mark.usefixtures("one_design")
@pytest.mark.parametrize(("after", "enough"), [(30, True), (3, False), (0, False)])
def test_broken_off_what_was_drawn_is_kept_and_summed_up_if_it_is_enough(
    after, enough, polish_sim, tmp_path, monkeypatch
):
    def interrupted(trial: PairBudgetTrial, number: int) -> dict[str, Any]:
        if number == after:
            raise KeyboardInterrupt
        return drawn_cheaply(trial, number)

    monkeypatch.setattr("polish_sim.dual.budget.draw_errors", interrupted)
    code, _, err = polish_sim("calibrate", "budget", "--on", "here", "--out", "cut")
    assert code == 130
    assert "interrupted" in err
    assert [path.name for path in tmp_path.iterdir()] == ["cut"] * (after > 0)
    if after:
        assert (tmp_path / "cut" / "rows.jsonl").read_bytes().count(b"\n") == after
    if enough:
        assert metrics_of(tmp_path / "cut")["draws"] == after
