"""Errors of calibrations at the tool: what is drawn is what the covariances say, and little enough."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.dual.budget import BudgetTrial, ErrorBudget, run_error_budget


@pytest.fixture(scope="module")
def budget() -> ErrorBudget:
    return run_error_budget(BudgetTrial(draws=60))


def test_each_share_is_what_its_covariance_says(budget: ErrorBudget) -> None:
    """Sixty draws of three coordinates tell an rms to 5 to 9%."""
    for share in budget.shares.values():
        assert share.drawn == pytest.approx(share.stated, rel=0.2)


def test_independent_shares_add_up_in_squares(budget: ErrorBudget) -> None:
    parts = [share.stated for name, share in budget.shares.items() if name != "all"]
    assert budget.shares["all"].stated == pytest.approx(np.sqrt(np.sum(np.square(parts))))


def test_the_relative_tool_error_is_as_small_as_asked(budget: ErrorBudget) -> None:
    assert budget.shares["all"].stated <= 6e-5
    assert budget.p95 <= 1e-4
