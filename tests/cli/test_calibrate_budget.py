"""`polish-sim calibrate budget` as a user calls it."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from polish_sim.dual import budget
from polish_sim.dual.budget import PairBudgetTrial
from tests.cli.conftest import metrics_of, refused

_predict = cache(budget.predict)


@pytest.fixture(autouse=True)
def numbers(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of the draws that were made, at first order: a calibration each would take most of the time, as
    would ten designs of them for the prediction. Real draws are compared in tests/dual."""
    made: list[int] = []

    def drawn(trial: PairBudgetTrial, number: int) -> dict[str, Any]:
        made.append(number)
        rng, found = np.random.default_rng(number), _predict(trial)
        unknowns = {name: rng.multivariate_normal(np.zeros(15), C) for name, C in found.shares.items()}
        unknowns[budget.TOGETHER] = np.sum(list(unknowns.values()), axis=0)
        return {name: found.slopes @ x for name, x in unknowns.items()}

    monkeypatch.setattr(budget, "DESIGNS", 1)
    monkeypatch.setattr(budget, "draw_errors", drawn)
    monkeypatch.setattr(budget, "predict", _predict)
    return made


def test_a_budget_draws_only_what_is_missing_and_with_worse_instruments_falls_short(
    polish_sim, tmp_path, numbers
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
    assert polish_sim(*words, "--draws", "30").code == 0
    assert metrics_of(tmp_path / "one") == figures
    assert polish_sim(*words, "--draws", "32").code == 0
    assert numbers == list(range(32))
    assert "another calibrate-budget" in polish_sim(*words, "--draws", "32", "--seed", "1").err
    words = "calibrate budget --draws 30 --tracker-noise 0 --touch-noise 0.2 --marks 4 --closing 0"
    assert polish_sim(*words.split(), "--on", "here", "--check", "--out", "bad").code == 1
    figures = metrics_of(tmp_path / "bad")
    assert figures["settings"]["marks"] == 4
    assert figures["settings"]["closing_touches"] == 0
    assert figures["sources"]["tool"]["predicted_rms_m"] == pytest.approx(2e-4 * np.sqrt(0.4), rel=1e-6)
    assert figures["sources"]["bases"]["predicted_rms_m"] == 0.0


@pytest.mark.parametrize(("after", "enough"), [(30, True), (3, False), (0, False)])
def test_interrupted_draws_are_kept_and_summed_up_if_enough(after, enough, polish_sim, tmp_path, monkeypatch):
    draw = budget.draw_errors

    def interrupted(trial: PairBudgetTrial, number: int) -> dict[str, Any]:
        if number == after:
            raise KeyboardInterrupt
        return draw(trial, number)

    monkeypatch.setattr(budget, "draw_errors", interrupted)
    refused(polish_sim("calibrate", "budget", "--on", "here", "--out", "cut"), "interrupted", code=130)
    assert [path.name for path in tmp_path.iterdir()] == ["cut"] * (after > 0)
    if after:
        assert (tmp_path / "cut" / "rows.jsonl").read_bytes().count(b"\n") == after
    if enough:
        assert metrics_of(tmp_path / "cut")["draws"] == after
