"""A part that moves: what it does to the force, with and without a force loop, against the closed form."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from polish_sim.cell import CellRun
from polish_sim.cell.real_part import SHIFT_SPEED, build_part_motion, move_part
from polish_sim.config import PartConfig
from tests.cell.cells import EVERY_STEP, cell_for, ideal, part_under, pressing_stroke
from tests.cell.fields import plane
from tests.cell.pressing import Array

STIFFNESS = 5000.0  # of head and pad in series [N/m]


def swinging(amplitude: float, frequency: float, *changes: str) -> CellRun:
    """Hold 20 N on a plane that moves along its normal."""
    motion = [f"part.motion_m={amplitude}", f"part.motion_hz={frequency}"]
    scenario = ideal("force", EVERY_STEP, *motion, *changes)
    return cell_for(scenario, pressing_stroke(hold=4.0), part=part_under(plane())).run()


def phasor(run: CellRun, frequency: float, turns: int) -> complex:
    """Force at this frequency [N], as the complex amplitude against sin(2 pi f t), over the last turns."""
    steps = round(turns / frequency * 1000)
    time, force = run.trace.time_s[-steps:], run.trace.normal_force_n[-steps:]
    return complex(2j * np.mean((force - force.mean()) * np.exp(-2j * np.pi * frequency * time)))


def test_without_a_force_loop_the_force_follows_the_part_by_k_times_its_travel() -> None:
    found = phasor(swinging(0.0005, 1.0, "controller.name=position"), 1.0, 2)
    assert abs(found) == pytest.approx(STIFFNESS * 0.0005, rel=0.02)
    assert cmath.phase(found) == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0])
def test_under_hybrid_pi_the_error_is_that_of_the_linear_loop(frequency: float) -> None:
    """The tool goes x = C (F0 - F - m x'') / s late, the spring gives F = k (x + d) for the part's travel d.

    C is the PI behind its 10 Hz filter, k head and pad with their dampers, m what the sensor carries; the delay is
    that of command, sensor, the sensor's low-pass and the servos.
    """
    s, travel, mass = 2j * math.pi * frequency, 0.0005, 2.0
    delay = 0.006 + 0.002 + 1.0 / (2.0 * math.pi * 80.0) + 0.004
    controller = (0.004 + 0.012 / s) / (1.0 + s / (2.0 * math.pi * 10.0)) * cmath.exp(-s * delay)
    spring = 1.0 / (1.0 / (STIFFNESS * 4.0 / 3.0 + 60.0 * s) + 1.0 / (STIFFNESS * 4.0 + 3.0 * 20.0 * s))
    moved = -controller * spring * travel / (s + controller * (spring + mass * s**2))
    found = phasor(swinging(travel, frequency), frequency, 1 if frequency < 1.0 else 2)
    assert abs(found - spring * (moved + travel)) < 0.05 * abs(found)


def test_the_trace_says_where_the_part_was() -> None:
    run = swinging(0.001, 2.0)
    expected = np.outer(0.001 * np.sin(4.0 * np.pi * run.trace.time_s), [0.0, 0.0, 1.0])
    np.testing.assert_allclose(run.trace.part_shift_m, expected, atol=1e-12)


def test_the_callers_part_stays_where_it_is() -> None:
    part = part_under(plane())
    cell_for(ideal("force", "part.motion_m=0.001"), pressing_stroke(hold=1.0), part=part).run()
    np.testing.assert_allclose(part.position, part_under(plane()).position, atol=0.0)


def test_a_part_that_slips_moves_to_its_goal_at_its_speed_and_stays() -> None:
    part = part_under(plane())
    motion, position = build_part_motion(PartConfig(), part), part.position.copy()
    motion.goal[:] = 0.003, 0.0, 0.004
    places: list[Array] = []
    for step in range(400):
        move_part(motion, 0.001 * step, 0.001, position)
        places.append(position - part.position)
        assert np.linalg.norm(motion.velocity) <= SHIFT_SPEED * (1 + 1e-12)
    np.testing.assert_allclose(places[99], 0.4 * np.array([0.003, 0.0, 0.004]), atol=1e-12)
    np.testing.assert_allclose(places[-1], [0.003, 0.0, 0.004], atol=1e-15)
    np.testing.assert_array_equal(motion.velocity, 0.0)
