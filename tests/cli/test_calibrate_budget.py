"""`polish-sim calibrate budget` as a user calls it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from polish_sim.dual.budget import PairBudgetTrial, draw_errors
from tests.cli.conftest import Tool, metrics_of


@pytest.fixture
def one_design(monkeypatch: pytest.MonkeyPatch) -> None:
    """Predict with one design of the calibrations instead of ten."""
    monkeypatch.setattr("polish_sim.dual.budget.DESIGNS", 1)


@pytest.mark.pictures
@pytest.mark.usefixtures("one_design")
def test_a_budget_leaves_its_files_and_meets_what_is_asked(polish_sim: Tool, tmp_path: Path) -> None:
    call = polish_sim("calibrate", "budget", "--draws", "30", "--check", "--out", "one")
    assert call.code == 0
    assert "draw 30 calibrations" in call.err
    assert {path.name for path in (tmp_path / "one").iterdir()} == {"metrics.json", "budget.png"}
    figures = metrics_of(tmp_path / "one")
    sources = figures["sources"]
    assert set(sources) == {"bases", "tool", "part", "closing", "together"}
    alone = [sources[name]["predicted_rms_m"] for name in ("bases", "tool", "part", "closing")]
    assert sources["together"]["predicted_rms_m"] == pytest.approx(np.linalg.norm(alone))
    assert figures["relative_error_rms_m"] == sources["together"]["drawn_rms_m"]
    assert figures["settings"]["tracker_noise_m"] == 3e-5


def drawn_cheaply(trial: PairBudgetTrial, count: int) -> Iterator[dict[str, Any]]:
    """Draws as large as one real draw: a calibration each would take most of the time."""
    drawn, rng = next(draw_errors(trial)), np.random.default_rng(0)
    for _ in range(count):
        yield {name: rng.standard_normal() * errors for name, errors in drawn.items()}


@pytest.mark.usefixtures("one_design")
def test_worse_instruments_fall_short(
    polish_sim: Tool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("polish_sim.dual.budget.draw_errors", lambda trial: drawn_cheaply(trial, 30))
    noise = ("--tracker-noise", "0", "--touch-noise", "0.2")
    words = ("--draws", "30", *noise, "--marks", "4", "--closing", "0", "--check", "--out", "bad")
    assert polish_sim("calibrate", "budget", *words).code == 1
    figures = metrics_of(tmp_path / "bad")
    assert figures["settings"]["marks"] == 4
    assert figures["settings"]["closing_touches"] == 0
    assert figures["sources"]["tool"]["predicted_rms_m"] == pytest.approx(2e-4 * np.sqrt(0.4), rel=1e-6)
    assert figures["sources"]["bases"]["predicted_rms_m"] == 0.0


@pytest.mark.usefixtures("one_design")
@pytest.mark.parametrize(("after", "kept"), [(30, True), (3, False)])
def test_broken_off_what_was_drawn_is_kept_if_it_is_enough(
    after: int, kept: bool, polish_sim: Tool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(trial: PairBudgetTrial) -> Iterator[dict[str, Any]]:
        yield from drawn_cheaply(trial, after)
        raise KeyboardInterrupt

    monkeypatch.setattr("polish_sim.dual.budget.draw_errors", interrupted)
    code, _, err = polish_sim("calibrate", "budget", "--out", "cut")
    assert code == 130
    assert "interrupted" in err
    assert [path.name for path in tmp_path.iterdir()] == ["cut"] * kept
    if kept:
        assert metrics_of(tmp_path / "cut")["draws"] == after
