"""Scenarios whose explicit contact, sensor or robot cannot work at this step are refused by the name of the
limit."""

from __future__ import annotations

import re

import pytest

from polish_sim.cell.limits import check_rates, check_step_limits
from polish_sim.errors import ConfigError, InputError
from polish_sim.experiments import run_experiment
from polish_sim.experiments.assembly import modelled_depth
from tests.cell.cells import cell_for, free_stroke, ideal, tool_pose

TANGENTIAL_MASS = 4.0  # [kg]


def accepted(*changes: str) -> None:
    scenario = ideal("force", *changes)
    force = scenario.process.contact_force_n
    check_step_limits(scenario, force, TANGENTIAL_MASS, modelled_depth(scenario, force))
    check_rates(scenario)


@pytest.mark.parametrize(
    ("key", "inside", "beyond", "more"),
    [
        ("pad.damping_s_m", 1.9, 2.1, ["simulation.control_every=2"]),
        ("pad.stiffness_n_m", 3.61, 8.0, []),
        ("pad.friction", 1.9, 4.0, []),
        ("process.contact_force_n", 1.9, 2.2, []),
    ],
)
def test_the_defaults_are_well_inside(key: str, inside: float, beyond: float, more: list[str]) -> None:
    """What the limits count may be nearly twice as large; a few times as large it is refused by its name."""
    section, name = key.split(".")
    usual = getattr(getattr(ideal("force"), section), name)
    accepted(f"{key}={inside * usual}", *more)
    with pytest.raises(ConfigError, match=re.escape(key)):
        accepted(f"{key}={beyond * usual}", *more)


STIFFEST = 0.49 * 0.3 / 1e-6 - 20000.0 / 3.0  # dt w of head and pad is 0.7 there [N/m]
SHARPEST = 0.3 * 20.0 * 0.001 / TANGENTIAL_MASS  # mu F dt / (v_s m) is 1 there [m/s]


@pytest.mark.parametrize(
    ("refusing", "words", "accepting"),
    [
        (
            ["pad.damping_s_m=10", "safety.force_limit_n=31"],
            ["pad.damping_s_m", "a F dt / m = 1.0"],
            ["pad.damping_s_m=10", "safety.force_limit_n=29"],
        ),
        (
            ["pad.damping_s_m=3", "safety.force_limit_n=101"],
            ["a F dt / m = 1.0"],
            ["pad.damping_s_m=3", "safety.force_limit_n=99"],
        ),
        (
            [f"pad.stiffness_n_m={1.01 * STIFFEST}"],
            ["pad.stiffness_n_m", "0.70"],
            [f"pad.stiffness_n_m={0.99 * STIFFEST}"],
        ),
        (["head.mass_kg=0.05", "pad.damping_s_m=0"], ["too stiff"], []),
        (["simulation.timestep_s=0.003", "pad.damping_s_m=0"], ["too stiff"], []),
        (
            [f"pad.friction_smoothing_m_s={0.99 * SHARPEST}"],
            ["pad.friction_smoothing_m_s", "1.01"],
            [f"pad.friction_smoothing_m_s={1.01 * SHARPEST}"],
        ),
        (["pad.stiffness_n_m=1999"], ["pad.stiffness_n_m"], ["pad.stiffness_n_m=2001"]),
        (
            ["sensor.rate_hz=2000"],
            ["sensor.rate_hz = 2000", "1000"],
            ["sensor.rate_hz=2000", "simulation.timestep_s=0.0005"],
        ),
        # A slow sensor is not to be taken for a frozen one.
        (
            ["sensor.rate_hz=40"],
            ["safety.sensor_timeout_s"],
            ["sensor.rate_hz=40", "safety.sensor_timeout_s=0.05"],
        ),
        # A command must outlive the control cycle.
        (
            ["simulation.control_every=4", "robot.command_timeout_s=0.006"],
            ["robot.command_timeout_s"],
            ["simulation.control_every=4", "robot.command_timeout_s=0.008"],
        ),
        # A spindle is to be seen five times a turn.
        (
            ["spindle.speed_rpm=15000"],
            ["spindle.speed_rpm = 15000", "4.0 times a turn", "Lower it to 12000"],
            ["spindle.speed_rpm=12000"],
        ),
        (["spindle.speed_rpm=15000"], [], ["spindle.speed_rpm=15000", "spindle.imbalance_m_s=0"]),
        (["spindle.speed_rpm=15000"], [], ["spindle.speed_rpm=15000", "simulation.timestep_s=0.0005"]),
    ],
)
def test_beyond_a_limit_it_is_refused_with_its_keys_and_within_it_accepted(
    refusing: list[str], words: list[str], accepting: list[str]
) -> None:
    with pytest.raises(ConfigError) as caught:
        accepted(*refusing)
    for word in words:
        assert word in str(caught.value)
    accepted(*accepting)


@pytest.mark.parametrize("change", ["pad.damping_s_m=20", "pad.friction_smoothing_m_s=1e-5"])
def test_an_experiment_refuses_them_before_it_moves(change: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(change.partition("=")[0])):
        run_experiment(ideal("force", change))


def test_a_controller_that_cannot_be_reset_is_named() -> None:
    class Stubborn:
        def reset(self, cycle_s: float) -> None:
            raise RuntimeError(f"no gains for {cycle_s} s")

        def step(self, measurement: object, target: object) -> list[float]:
            return [0.0] * 6

    with pytest.raises(InputError, match=r"reset\(\).*no gains for 0.001 s"):
        cell_for(ideal("arc"), free_stroke(tool_pose(0, -0.5, 0.2)), controller=Stubborn())  # type: ignore[arg-type]


def test_the_part_is_modelled_as_deep_as_a_soft_pad_goes() -> None:
    assert modelled_depth(ideal("force"), 20.0) == 0.008
    # 2 x 20 N / 4000 N/m
    assert modelled_depth(ideal("force", "head.spring_scale=0.2"), 20.0) == pytest.approx(0.010)
