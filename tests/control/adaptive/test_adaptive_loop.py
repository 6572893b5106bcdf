"""The composed law on a spring in closed form: it lands fast on any spring at any delay, follows a rise."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from polish_sim.control import CONTROLLERS
from polish_sim.control.adaptive.gains import LAWS
from polish_sim.control.signals import CompiledController
from polish_sim.errors import ConfigError
from tests.control.adaptive.plant import Plant, land, settling
from tests.control.signals import CONFIG, measurement_at_rest, target_to_press


def adaptive(without: str = "", **changes: Any) -> CompiledController:
    laws = {"laws": " ".join(name for name in LAWS if name != without), **changes}
    made = replace(CONFIG, adaptive=replace(CONFIG.adaptive, damping_n_s_m=0.0, **laws))
    return CONTROLLERS["hybrid-adaptive"](made)


@pytest.mark.parametrize("scale", [0.2, 1.0, 5.0])
@pytest.mark.parametrize(("command", "sensor"), [(2, 1), (17, 5)])
def test_it_lands_on_any_spring_at_any_delay_without_being_told(scale, command, sensor):
    run = land(adaptive(), Plant(stiffness=5000.0 * scale, command_delay=command, sensor_delay=sensor))
    # What cannot strike on stiff springs takes its time for the 20 mm that soft ones give by.
    assert settling(run, 20.0) < (1.0 if scale < 1.0 else 0.35)
    assert run.force.max() < 22.0
    assert np.abs(run.force[-300:] - 20.0).max() < 0.1


@pytest.mark.parametrize(("approach", "force"), [(0.002, 20.0), (0.05, 20.0), (0.02, 3.0), (0.02, 50.0)])
def test_landing_takes_less_than_a_quarter_second_whatever_approach_and_force(approach, force):
    run = land(adaptive(), Plant(noise=0.5), approach, set_force=force)
    assert settling(run, force) < (0.25 if force == 20.0 else 0.3)
    assert run.force.max() < force + 1.0


@pytest.mark.parametrize("rise", [-0.004, 0.004])
def test_a_part_that_rises_steadily_leaves_what_it_rises_within_the_lags(rise):
    """The observer's rate integrates; what stays is k v (command 9 + sensor 3 + low-pass 2 ms) = 0.28 N."""
    run = land(adaptive(), Plant(rise=rise), seconds=2.0)
    assert np.abs(run.force[(run.time > 0.6) & (run.time < 0.7)] - 20.0).max() > 0.4
    np.testing.assert_allclose(run.force[-200:] - 20.0, 5000.0 * rise * 0.014, rtol=0.25)


SOFT = Plant(stiffness=1000.0, mass=2.4, command_delay=15, sensor_delay=5)


@pytest.mark.parametrize(
    ("law", "plant", "since", "off"),
    [*((law, Plant(), 1.7, 0.2) for law in ("touch-down", "stiffness", "inertia")), ("", SOFT, 2.0, 0.1)],
)
def test_without_one_law_the_others_still_land_and_with_all_inertia_does_not_ring(law, plant, since, off):
    run = land(adaptive(without=law), plant, seconds=since + 0.5)
    assert np.abs(run.force[run.time >= since] - 20.0).max() < off


def test_touch_down_makes_the_landing_faster_and_stiffness_holds_a_spring_five_times_as_stiff():
    slow, fast = (land(adaptive(law), Plant(noise=0.5), approach=0.002) for law in ("touch-down", ""))
    assert settling(fast, 20.0) < 0.8 * settling(slow, 20.0)
    stiff = Plant(stiffness=25000.0, command_delay=17, sensor_delay=5)
    assert land(adaptive(), stiff).force.max() < 21.0
    assert land(adaptive("stiffness"), stiff).force.max() > 25.0


def test_noise_that_looks_like_contact_does_not_set_the_force_loop_on_the_air():
    """The sequence takes noise for contact half a metre above the part: the approach speed is kept."""
    controller, rng = adaptive(), np.random.default_rng(0)
    controller.reset(0.001)
    m, t = measurement_at_rest(), target_to_press()
    t.twist[2] = 0.01
    speeds = []
    for k in range(3000):
        m.wrench[2] = rng.normal()
        t.contact = k > 1000
        m.twist[2] = 0.01
        speeds.append(controller.step(m, t)[2])
    assert np.max(speeds[1001:]) < 0.02
    assert np.mean(speeds[1001:]) == pytest.approx(0.01, rel=0.05)


def test_a_law_that_does_not_exist_is_refused_with_the_names_there_are():
    with pytest.raises(ConfigError, match=r"'touchdown'.*touch-down, stiffness"):
        adaptive(laws="touchdown")
