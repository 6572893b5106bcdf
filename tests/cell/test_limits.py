"""Scenarios whose explicit contact, sensor or robot cannot work at this step are refused by the name of the limit."""

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


def refused(*changes: str) -> str:
    with pytest.raises(ConfigError) as caught:
        accepted(*changes)
    return str(caught.value)


def test_the_defaults_are_well_inside() -> None:
    """What the limits count may be nearly twice as large; the pad's damping then meets the first of them."""
    pad, force = ideal("force").pad, ideal("force").process.contact_force_n
    accepted(f"pad.damping_s_m={1.9 * pad.damping_s_m}", "simulation.control_every=2")
    assert "a F dt / m = 1.05" in refused(f"pad.damping_s_m={2.1 * pad.damping_s_m}")
    accepted(f"pad.stiffness_n_m={1.9**2 * pad.stiffness_n_m}")
    accepted(f"pad.friction={1.9 * pad.friction}")
    accepted(f"process.contact_force_n={1.9 * force}")


@pytest.mark.parametrize(("damping", "safe_n"), [(10.0, 30.0), (3.0, 100.0)])
def test_the_pads_damping_needs_a_f_dt_over_m_below_one(damping: float, safe_n: float) -> None:
    accepted(f"pad.damping_s_m={damping}", f"safety.force_limit_n={safe_n - 1}")
    told = refused(f"pad.damping_s_m={damping}", f"safety.force_limit_n={safe_n + 1}")
    assert "pad.damping_s_m" in told
    assert "a F dt / m = 1.0" in told


def test_head_and_pad_need_dt_omega_below_0_7() -> None:
    k_limit = 0.49 * 0.3 / 1e-6 - 20000.0 / 3.0
    accepted(f"pad.stiffness_n_m={0.99 * k_limit}")
    told = refused(f"pad.stiffness_n_m={1.01 * k_limit}")
    assert "pad.stiffness_n_m" in told
    assert "0.70" in told
    assert "too stiff" in refused("head.mass_kg=0.05", "pad.damping_s_m=0")
    assert "too stiff" in refused("simulation.timestep_s=0.003", "pad.damping_s_m=0")


def test_friction_needs_mu_f_dt_over_v_s_m_below_one() -> None:
    v_limit = 0.3 * 20.0 * 0.001 / TANGENTIAL_MASS
    accepted(f"pad.friction_smoothing_m_s={1.01 * v_limit}")
    told = refused(f"pad.friction_smoothing_m_s={0.99 * v_limit}")
    assert "pad.friction_smoothing_m_s" in told
    assert "1.01" in told


def test_a_pad_softer_than_the_part_is_deep_is_refused() -> None:
    accepted("pad.stiffness_n_m=2001")
    assert "pad.stiffness_n_m" in refused("pad.stiffness_n_m=1999")


def test_a_sensor_cannot_be_faster_than_the_physics() -> None:
    told = refused("sensor.rate_hz=2000")
    assert "sensor.rate_hz = 2000" in told
    assert "1000" in told
    accepted("sensor.rate_hz=2000", "simulation.timestep_s=0.0005")


def test_a_slow_sensor_is_not_to_be_taken_for_a_frozen_one() -> None:
    told = refused("sensor.rate_hz=40")
    assert "safety.sensor_timeout_s" in told
    accepted("sensor.rate_hz=40", "safety.sensor_timeout_s=0.05")


def test_a_command_must_outlive_the_control_cycle() -> None:
    assert "robot.command_timeout_s" in refused("simulation.control_every=4", "robot.command_timeout_s=0.006")
    accepted("simulation.control_every=4", "robot.command_timeout_s=0.008")


@pytest.mark.parametrize(
    "change", ["pad.damping_s_m=20", "pad.stiffness_n_m=500000", "pad.friction_smoothing_m_s=1e-5"]
)
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


def test_a_spindle_is_to_be_seen_five_times_a_turn() -> None:
    accepted("spindle.speed_rpm=12000")
    told = refused("spindle.speed_rpm=15000")
    assert "spindle.speed_rpm = 15000" in told
    assert "4.0 times a turn" in told
    assert "Lower it to 12000" in told
    accepted("spindle.speed_rpm=15000", "spindle.imbalance_m_s=0")
    accepted("spindle.speed_rpm=15000", "simulation.timestep_s=0.0005")


def test_the_part_is_modelled_as_deep_as_a_soft_pad_goes() -> None:
    assert modelled_depth(ideal("force"), 20.0) == 0.008
    assert modelled_depth(ideal("force", "head.spring_scale=0.2"), 20.0) == pytest.approx(0.010)  # 2 x 20 N / 4000 N/m
