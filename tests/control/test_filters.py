"""The low-pass against its analytic response."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polish_sim.control.loops import low_pass_step


@pytest.mark.parametrize("dt", [1e-4, 1e-3, 0.02])
@pytest.mark.parametrize("corner_hz", [1.0, 10.0, 80.0])
def test_a_step_is_answered_exactly_at_any_sampling(dt: float, corner_hz: float) -> None:
    output = 0.0
    for n in range(1, 200):
        output = low_pass_step(output, 1.0, corner_hz, dt)
        assert output == pytest.approx(1.0 - math.exp(-2.0 * math.pi * corner_hz * n * dt), abs=1e-12)


def test_a_sine_at_the_corner_is_halved_in_power() -> None:
    dt, corner_hz = 1e-5, 10.0
    output, outputs = 0.0, []
    for n in range(100_000):
        output = low_pass_step(output, math.sin(2.0 * math.pi * corner_hz * n * dt), corner_hz, dt)
        outputs.append(output)
    amplitude = max(outputs[-20_000:])
    assert amplitude == pytest.approx(1.0 / math.sqrt(2.0), rel=1e-3)


def test_a_constant_passes_unchanged() -> None:
    assert low_pass_step(3.25, 3.25, 10.0, 0.001) == 3.25
    assert np.isfinite(low_pass_step(0.0, 1.0, 1e9, 1.0))
