"""Scenarios whose contact, sensor or robot cannot work at this step are refused by the limit's name."""

import re
from dataclasses import replace

import pytest

from polish_sim.cell import limits
from polish_sim.errors import ConfigError
from polish_sim.experiments import run_experiment
from tests.cell.cells import ideal

TANGENTIAL_MASS = 4.0  # [kg]


def accepted(*changes: str) -> None:
    scenario = ideal("force", "safety.force_limit_n=30", *changes)
    force, pad, dt = scenario.process.contact_force_n, scenario.pad, scenario.simulation.timestep_s
    limits.check_contact_settings(pad, scenario.head, scenario.safety, dt, force)
    limits.check_friction(pad, dt, force, TANGENTIAL_MASS)
    limits.check_depth(pad, scenario.head, force, limits.modelled_depth(scenario.head, pad, force))
    limits.check_rates(scenario)


STIFFEST = 0.49 * 0.3 / 1e-6 - 20000.0 / 3.0  # dt w of head and pad is 0.7 there [N/m]
SHARPEST = 0.3 * 20.0 * 0.001 / TANGENTIAL_MASS  # mu F dt / (v_s m) is 1 there [m/s]
SMOOTH, SLOW = "pad.friction_smoothing_m_s", "simulation.control_every=4 robot.command_timeout_s"
STIFF = "pad.damping_s_m=0 pad.stiffness_n_m"
FAST = "spindle.speed_rpm=15000"


@pytest.mark.parametrize(
    ("refused", "named", "within"),
    [
        ("pad.damping_s_m=10.3", "pad.damping_s_m", "pad.damping_s_m=9.7"),
        ("safety.force_limit_n=23", "safety.force_limit_n", "safety.force_limit_n=25"),
        (f"{STIFF}={1.01 * STIFFEST}", "pad.stiffness_n_m", f"{STIFF}={0.99 * STIFFEST}"),
        ("head.mass_kg=0.05 pad.damping_s_m=0", "too stiff", ""),
        (f"{SMOOTH}={0.99 * SHARPEST}", SMOOTH, f"{SMOOTH}={1.01 * SHARPEST}"),
        ("pad.stiffness_n_m=1999", "pad.stiffness_n_m", "pad.stiffness_n_m=2001"),
        ("sensor.rate_hz=2000", "sensor.rate_hz", "sensor.rate_hz=2000 simulation.timestep_s=0.0005"),
        # A slow sensor is not to be taken for a frozen one.
        ("sensor.rate_hz=40", "safety.sensor_timeout_s", "sensor.rate_hz=40 safety.sensor_timeout_s=0.05"),
        # A command must outlive the control cycle.
        (f"{SLOW}=0.006", "robot.command_timeout_s", f"{SLOW}=0.008"),
        # A spindle is to be seen five times a turn.
        (FAST, "Lower it to 12000", "spindle.speed_rpm=12000"),
        (FAST, "spindle.speed_rpm", f"{FAST} spindle.imbalance_m_s=0"),
        (FAST, "spindle.speed_rpm", f"{FAST} simulation.timestep_s=0.0005"),
    ],
)
def test_beyond_a_limit_it_is_refused_and_within_accepted(refused, named, within):
    with pytest.raises(ConfigError, match=re.escape(named)):
        accepted(*refused.split())
    accepted(*within.split())


def test_an_experiment_refuses_them_before_it_moves():
    for key, value in (("pad.damping_s_m", 20), (SMOOTH, 1e-5), ("sensor.rate_hz", 40)):
        with pytest.raises(ConfigError, match=key):
            run_experiment(ideal("force", f"{key}={value}"))


def test_the_part_is_modelled_as_deep_as_a_soft_pad_goes():
    """2 x 20 N / 4000 N/m."""
    usual = ideal("force")
    assert limits.modelled_depth(usual.head, usual.pad, 20.0) == 0.008
    soft = replace(usual.head, spring_scale=0.2)
    assert limits.modelled_depth(soft, usual.pad, 20.0) == pytest.approx(0.010)
