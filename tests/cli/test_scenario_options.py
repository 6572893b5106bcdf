"""Options in mm, deg, N and mm/s reach the scenario in SI, and say what is wrong in the user's words."""

import math
from dataclasses import fields

import numpy as np
import pytest

from polish_sim.cli.options import OWN, build_scenario, config_keys, named_options, refuse_idle_on_path, takes
from polish_sim.config import PlanConfig, Scenario
from polish_sim.config.key import Unit
from polish_sim.errors import ConfigError, InputError, PolishSimError
from polish_sim.experiments import run_experiment
from polish_sim.experiments.registry import default_scenario, experiment, refuse_idle_options
from polish_sim.scenario_file import leaves, merge, override

KEYS = config_keys(Scenario())


def built(words, **more):
    """The scenario of options as a user writes them."""
    read = {**KEYS, **OWN}
    given = {name: read[name].read(str(value)) for name, value in words.items()}
    return build_scenario(Scenario(), given | more)


def test_options_land_in_their_keys_in_si():
    landed = [
        ("--part", "plate", "part.file", "plate"),
        ("--part-pose", "-100,-500,50,0,0,90", "part.pose", (-0.1, -0.5, 0.05, 0.0, 0.0, math.pi / 2)),
        ("--contact-force", 15.0, "process.contact_force_n", 15.0),
        ("--feed", 12.0, "process.feed_m_s", 0.012),
        ("--pad-diameter", 30.0, "pad.radius_m", 0.015),
        ("--spindle-rpm", 3000.0, "spindle.speed_rpm", 3000.0),
        ("--feature-angle", 20.0, "plan.feature_angle_rad", math.radians(20.0)),
        ("--hole-margin", 2.0, "plan.hole_margin_m", 0.002),
        ("--edge-margin", 3.0, "plan.edge_margin_m", 0.003),
        ("--axis-smoothing", 15.0, "plan.axis_smoothing_m", 0.015),
        ("--order", "outward", "plan.order", "outward"),
        ("--direction", "climb", "plan.direction", "climb"),
        ("--lead-in", "arc", "plan.lead_in", "arc"),
        ("--start", "10,-20,30", "plan.start", (0.01, -0.02, 0.03)),
        ("--raster-direction", "0,1,0", "plan.raster_direction", (0.0, 1.0, 0.0)),
        ("--seed", 4, "seed", 4),
        ("--log-rate", "full", "simulation.log_rate_hz", 0.0),
    ]
    values = dict(leaves(built({option: value for option, value, _, _ in landed})))
    assert [values[key] for _, _, key, _ in landed] == [pytest.approx(value) for *_, value in landed]


def test_set_beats_options_that_beat_the_file_and_a_zero_is_given_a_switch_that_is_off_not(tmp_path):
    assert build_scenario(Scenario(), {"--feed": None, "--part": None}) == Scenario()
    file = tmp_path / "mine.toml"
    file.write_text("[process]\nfeed_m_s = 0.002\ncontact_force_n = 5.0\n[pad]\npoints = 50\n")
    more = {"--config": file, "--set": ["process.contact_force_n=7.0", "pad.radius_m=0.02"]}
    scenario = built({"--feed": 3.0, "--contact-force": 6.0, "--overlap": 70.0}, **more)
    assert scenario.pad.points == 50
    assert scenario.process.feed_m_s == pytest.approx(0.003)
    assert scenario.process.contact_force_n == 7.0
    assert scenario.plan.stepover_m == pytest.approx(0.012)  # the overlap counts on the pad that --set says
    file.write_text('experiment = "arc"\n')
    with pytest.raises(ConfigError, match=r"'arc', not 'surface'"):
        built({}, **{"--config": file})

    @takes("--spindle-rpm", "--set", "--view")
    def command(given):
        return given

    given = command(option_0=0.0, option_1=False, option_2=[])
    assert given == {"--spindle-rpm": 0.0, "--set": None, "--view": None}


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--stepover", -8.0, r"--stepover -8 .* 0\.2 to 1000 mm"),
        ("--feed", math.nan, r"--feed nan is outside 0\.1 to 500 mm/s"),
        ("--pad-diameter", 500.0, "--pad-diameter 500 .* 2 to 400 mm"),
        ("--start", "1,2,inf", r"--start '1,2,inf' is not X,Y,Z"),
        ("--raster-direction", "0,0,0", "not all zero"),
        ("--part-pose", "1,2,3", "six numbers in mm and deg"), ("--overlap", 100.0, r"step-over of 0 mm"),
        ("--overlap", "nan", r"nan is outside 0 to 100\.$"), ("--overlap", 99.9, r"step-over of 0\.05 mm"),
        ("--log-rate", "fast", "--log-rate 'fast' is not a number .*full"),
        ("--stepover", "8mm", r"'8mm' is not a number \(mm\)\. Write 8\."),
        ("--feed", "20.5 mm/s", r"mm/s or auto\)\. Write 20\.5\."),
        ("--stepover", "8cm", r"not a number \(mm\)\.$"),
        ("--stepover", "0.008", r"--stepover 0\.008 .* 0\.008 m write 8\."),
        ("--seed", "1" * 400, r"--seed 1+\.\.\. \(400 digits\) .* 0 to"),
        ("--seed", "1.5", r"--seed '1\.5' is not a whole number"),
    ],
)  # fmt: skip
def test_a_bad_value_is_named_with_its_option(option, value, said):
    with pytest.raises(PolishSimError, match=said):
        built({option: value})


def test_a_number_out_of_range_is_answered_without_the_key_s_name_or_unit():
    scalars = [key for key in KEYS.values() if isinstance(key.option.unit, Unit) and not key.spec["length"]]
    assert scalars
    for key in scalars:
        with pytest.raises(ConfigError) as raised:
            built({key.option.name: 1e9})
        assert f" {key.option.unit.name}: " in str(raised.value)
        assert key.name not in str(raised.value)
        assert "[" not in str(raised.value)


def test_of_the_options_of_a_path_those_pass_that_change_something_and_others_are_refused_as_they_were_said():
    def refuse(row, *options):
        refuse_idle_options(row, {option: option for option in options})

    refuse(experiment("surface"), "--stepover", "--overlap", "--order", "--lead-in", "--start")
    assert "--direction" not in named_options({"--set": ["guide.direction=x"]})
    without = "--stepover would change nothing without --even-removal or --removal"
    with pytest.raises(InputError, match=without):
        refuse(experiment("dual"), "--stepover")
    for asked in ("--even-removal", "--removal"):
        refuse(experiment("dual"), asked, "--stepover")
    with pytest.raises(InputError, match="give --axis-smoothing MM as well"):
        refuse_idle_on_path(PlanConfig(), {"--axis-deviation": 3.0})
    refuse_idle_on_path(PlanConfig(axis_smoothing_m=0.01), {"--axis-deviation": 3.0})
    for name, word in (
        ("arc", "plan.stepover_m"), ("arc", "part.motion_m"), ("force", "plan.stepover_m"),
        ("surface", "drag.follow"), ("smooth", "controller.force_p_m_sn"), ("dual", "hand.distance_m"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=f"--set {word} would change nothing in 'run {name}'"):
            refuse_idle_options(experiment(name), named_options({"--set": ["seed=1", f"{word}=1"]}))


@pytest.mark.parametrize(
    ("name", "short"),
    [
        ("arc", "process.max_feed_s=0.5"),
        ("force", "process.hold_s=1.0"),
        ("teach", "guide.duration_s=1.0 guide.mode=inertia guide.direction=x"),
    ],
)
def test_of_a_section_that_is_called_idle_no_number_changes_a_run(name, short):
    changed = usual = override(default_scenario(name), short.split())
    for section in experiment(name).idle:
        table = getattr(usual, section)
        numbers = {f.name: f for f in fields(table) if type(getattr(table, f.name)) is float}
        values = {key: 0.5 * (getattr(table, key) + f.metadata["high"]) for key, f in numbers.items()}
        changed = merge(changed, {section: values}, "")
    assert changed != usual
    first, second = (run_experiment(scenario).log.columns for scenario in (usual, changed))
    for column in first:
        np.testing.assert_array_equal(first[column], second[column], column)


def test_a_user_s_files_are_named_from_the_root(tmp_path, monkeypatch):
    (tmp_path / "mine.py").touch()
    (tmp_path / "mine.toml").touch()
    monkeypatch.chdir(tmp_path)
    limits = built({}, **{"--set": ["smoothing.limits_file=mine.toml"]}).smoothing.limits_file
    assert limits == str(tmp_path.resolve() / "mine.toml")
    controller = built({"--controller": "mine.py:Down"}).controller
    assert controller.name == f"{tmp_path.resolve() / 'mine.py'}:Down"
    assert controller.label == "mine.py:Down"
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert built({}, **{"--set": [f"controller.name={controller.name}"]}).controller == controller
