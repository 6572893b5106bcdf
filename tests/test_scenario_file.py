"""Settings: defaults, ranges, TOML files and --set."""

import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from functools import reduce
from typing import Any

import pytest

from polish_sim.config import Scenario
from polish_sim.config.cell import SENSOR_MODELS
from polish_sim.errors import ConfigError, PolishSimError
from polish_sim.experiments.registry import ROWS, default_scenario
from polish_sim.scenario_file import check_words, load_scenario, override, to_toml


def leaves(table, place=""):
    """Every key of a scenario by its dotted name, with its value and its field."""
    for f in fields(table):
        value = getattr(table, f.name)
        if is_dataclass(value):
            yield from leaves(value, f"{place}{f.name}.")
        else:
            yield f"{place}{f.name}", value, f


BASE = Scenario()
UNITS = {
    "_m": "[m]", "_n": "[N]", "_s": "[s]", "_hz": "[Hz]", "_kg": "[kg]", "_rad": "[rad]", "_nm": "[N m]",
    "_m_s": "[m/s]", "_m_s2": "[m/s^2]", "_rad_s": "[rad/s]", "_rad_s2": "[rad/s^2]", "_n_m": "[N/m]",
    "_n_s_m": "[N s/m]", "_s_m": "[s/m]", "_rpm": "[1/min]", "_m_sn": "[m/(s N)]", "_m_s2n": "[m/(s^2 N)]",
    "_rad_snm": "[rad/(s N m)]", "_rad_s2nm": "[rad/(s^2 N m)]", "_n_s": "[N/sqrt(s)]",
    "_nm_s": "[N m/sqrt(s)]", "_1_pa": "[1/Pa]", "_j": "[J]", "_nm_rad": "[N m/rad]",
    "_nm_s_rad": "[N m s/rad]", "_kg_m3": "[kg/m^3]",
}  # fmt: skip
RATES = ("orientation_i_hz", "position_rate_p", "adaptive.normal_rate_1_s")
OTHER_UNITS = {f"controller.{key}": "[1/s]" for key in RATES}


def test_a_key_and_its_meaning_name_the_same_unit_and_the_file_holds_both():
    for key, value, field in leaves(Scenario()):
        if not isinstance(value, float):
            continue
        endings = [ending for ending in UNITS if key.endswith(ending)]
        unit = OTHER_UNITS.get(key, UNITS[max(endings, key=len)] if endings else "[-]")
        said = field.metadata["text"]
        assert unit in said or (unit == "[-]" and "[" not in said), key
    # Head and pad in series have the paper's stiffness.
    head, pad = Scenario().head.stiffness_n_m, Scenario().pad.stiffness_n_m
    assert 1.0 / (1.0 / head + 1.0 / pad) == pytest.approx(5000.0)
    text = to_toml(BASE)
    assert set(tomllib.loads(text)) == {key.partition(".")[0] for key, _, _ in leaves(BASE)}
    for key, value, field in leaves(BASE):
        begin = f"[{key}]" if isinstance(value, Mapping) else f"{key.rpartition('.')[2]} = "
        end = f"# {field.metadata['text']}"
        assert any(line.startswith(begin) and line.endswith(end) for line in text.splitlines()), key


def written(folder, text):
    path = folder / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    return path


def changed_everywhere():
    """A scenario that differs from the default in every number."""
    assignments = []
    for key, value, field in leaves(BASE):
        if isinstance(value, int):
            assignments.append(f"{key}={value + 1}")
        elif isinstance(value, float):
            low, high = field.metadata["low"], field.metadata["high"]
            other = value * 1.01 if value else 0.01 * min(high, 1.0)
            assignments.append(f"{key}={min(max(other, low), high)!r}")
    part = replace(BASE.part, file='my "best" part\\a.stl', pose=(0.1, -0.5, 0.2, 0.0, 1e-7, 3.1))
    return override(replace(BASE, part=part), assignments)


@pytest.mark.parametrize("scenario", [*map(default_scenario, ROWS), changed_everywhere()])
def test_toml_gives_back_the_very_same_scenario(scenario, tmp_path):
    assert load_scenario(written(tmp_path, to_toml(scenario)), default_scenario("arc")) == scenario


def test_keys_a_file_does_not_name_keep_their_value_and_a_later_set_wins(tmp_path):
    base = override(BASE, ["seed=1", "seed=7", "pad.friction=0.1"])
    assert base.seed == 7
    scenario = load_scenario(written(tmp_path, "[pad]\nradius_m = 0.02\n"), base)
    assert scenario == replace(base, pad=replace(base.pad, radius_m=0.02, choice="given"))
    # A list that is chosen is called auto or left empty.
    posed = override(BASE, ["part.pose=[0, -0.5, 0.1, 0, 0, 0]"])
    for chosen in ('"auto"', "[]"):
        found = load_scenario(written(tmp_path, f"part.pose = {chosen}\nplan.start = {chosen}\n"), posed)
        assert found.part.pose == ()
        assert found == override(posed, ["part.pose=auto", "plan.start=auto"])


BAD_FILES = [
    ("[pad]\nradios_m = 0.02", ["'pad.radios_m'", "radius_m"]),
    ("[robot.leg]\nx = 1", ["'robot.leg'", "command_latency_s"]),
    ("pad = 3", ["'pad'", "[pad]"]),
    ("[pad]\nradius_m = '2 cm'", ["'pad.radius_m'", "number", "2 cm"]),
    *((f"[pad]\nradius_m = {bad}", ["'pad.radius_m'", "number"]) for bad in ("true", "nan")),
    ("[pad]\npoints = 100.0", ["'pad.points'", "whole number"]),
    ("[part]\nfile = 3", ["'part.file'", "text"]),
    ("[part]\npose = [1, 2, 3]", ["'part.pose'", "six numbers"]),
    ("[part]\npose = [1, 2, 3, 4, 5, 'x']", ["'part.pose'", "six numbers"]),
    ("[guide]\ncoulomb_nm = [7, 7, 5, -1, 1, 1]", ["'guide.coulomb_nm'", "-1", "0 to 100", "[N m]"]),
    ("[pad]\nradius_m = -0.02", ["'pad.radius_m'", "-0.02", "0.001 to 0.2", "[m]"]),
    ("[pad\nradius_m = 1", ["not valid TOML"]),
    ("seed = 6 60", ["newline or end of document after"]),
    ("\xff\xfe", ["scenario.toml"]),
]


@pytest.mark.parametrize(("text", "told"), BAD_FILES)
def test_a_bad_file_names_the_key_and_what_would_do(tmp_path, text, told):
    (tmp_path / "scenario.toml").write_text(text, encoding="latin-1")
    with pytest.raises(ConfigError) as caught:
        load_scenario(tmp_path / "scenario.toml", BASE)
    assert [word for word in ("scenario.toml'", *told) if word not in str(caught.value)] == []
    with pytest.raises(ConfigError, match=r"none\.toml"):
        load_scenario(tmp_path / "none.toml", BASE)


@pytest.mark.parametrize(
    ("assignment", "key", "value"),
    [
        ("pad.friction=0.25", "pad.friction", 0.25), ("pad.friction=1", "pad.friction", 1.0),
        (" pad.friction = 1e-1 ", "pad.friction", 0.1), ("part.file=a=b.stl", "part.file", "a=b.stl"),
        ("controller.name=./mine.py:Mine", "controller.name", "./mine.py:Mine"),
        ("plan.region=point:1,2,3", "plan.region", "point:1,2,3"),
        ("part.pose=[0,-0.5,0.1,0,0,0]", "part.pose", (0.0, -0.5, 0.1, 0.0, 0.0, 0.0)),
    ],
)  # fmt: skip
def test_set_changes_one_key(assignment, key, value):
    before, after = ({k: v for k, v, _ in leaves(s)} for s in (BASE, override(BASE, [assignment])))
    assert after[key] == value
    assert type(after[key]) is type(before[key])
    assert {k for k in before if before[k] != after[k]} <= {key}


@pytest.mark.parametrize(
    ("assignment", "told"),
    [
        ("=3", "KEY=VALUE"), ("sede=3", "'sede'"), ("pad=0.02", "'pad'"), ("pad.radius_m=", "'pad.radius_m'"),
        ("pad.radius_m=" + "9" * 400, "'pad.radius_m' = 9+\\.\\.\\. .400 characters. .* 0.001 to 0.2"),
        ("sensor.model=axia8", "mean 'axia80'.* axia80, external, hex"),
    ],
)  # fmt: skip
def test_a_bad_set_is_named(assignment, told):
    with pytest.raises(PolishSimError, match=told):
        override(BASE, [assignment])


NOISE, AXIA = "sensor.force_noise_n", SENSOR_MODELS["axia80"]


def sensor_values(scenario):
    return {name: getattr(scenario.sensor, name) for name in AXIA}


@pytest.mark.parametrize("key", ["process.tare", "robot.real.servo_side", "safety.tool_in_part"])
def test_a_word_a_key_does_not_take_is_refused_in_a_file_and_in_a_scenario_made_in_python(key):
    with pytest.raises(PolishSimError, match=rf"{key} 'sideways'.* Known: "):
        override(Scenario(), [f"{key}=sideways"])
    *sections, name = key.split(".")
    made: Any = {name: "sideways"}
    for k in reversed(range(len(sections))):
        made = {sections[k]: replace(reduce(getattr, sections[: k + 1], Scenario()), **made)}
    check_words(Scenario())
    with pytest.raises(PolishSimError, match=rf"{key} 'sideways'.* Known: "):
        check_words(replace(Scenario(), **made))


def test_what_is_set_by_name_wins_over_a_named_sensor_whatever_the_order(tmp_path):
    value = BASE.sensor.force_noise_n  # though it is the default
    wanted = dict(AXIA) | {"force_noise_n": value}
    for order in (1, -1):
        pair = [f"{NOISE}={value}", "sensor.model=axia80"][::order]
        assert sensor_values(override(BASE, pair)) == wanted
        file = written(tmp_path, "\n".join([f"{NOISE} = {value}", 'sensor.model = "axia80"'][::order]))
        assert sensor_values(load_scenario(file, BASE)) == wanted


def test_a_named_sensor_stands_for_its_values_and_its_file_gives_the_same_again(tmp_path):
    assert sensor_values(override(BASE, ["sensor.model=axia80"])) == dict(AXIA)
    assert override(BASE, ["sensor.model=axia80", "sensor.model=hex-125hz", "sensor.model=external"]) == BASE
    assert all(not values or values.keys() == AXIA.keys() for values in SENSOR_MODELS.values())
    scenario = override(BASE, ["sensor.model=axia80", "sensor.rate_hz=100"])
    file = written(tmp_path, to_toml(scenario))
    assert load_scenario(file, BASE) == scenario
    assert tomllib.loads(file.read_text())["sensor"]["warm_up_s"] == AXIA["warm_up_s"]
    # Another sensor then replaces what was the first one's, not what was set by name.
    other = override(load_scenario(file, BASE), ["sensor.model=hex-125hz"])
    assert sensor_values(other) == dict(SENSOR_MODELS["hex-125hz"]) | {"rate_hz": 100.0}


def test_a_pad_or_a_step_over_that_is_set_by_name_is_kept_though_it_is_the_default(tmp_path):
    usual, pad, step = Scenario(), "pad.radius_m=0.025", "plan.stepover_m=0.008"
    for choice, given in (("given", [pad]), ("stepover", [step]), ("auto", ["pad.choice=auto", pad, step])):
        for order in (given, given[::-1]):
            asked = override(usual, order)
            assert asked == replace(usual, pad=replace(usual.pad, choice=choice))
            assert load_scenario(written(tmp_path, to_toml(asked)), usual) == asked
    assert override(usual, ["pad.radius_m=0.02", "plan.stepover_m=0.008"]).pad.choice == "given"
    for text, choice in (
        ("[plan]\nstepover_m = 0.008", "stepover"), ("[pad]\nradius_m = 0.025", "given"),
        ("[pad]\nradius_m = 0.025\nchoice = 'auto'", "auto"),
    ):  # fmt: skip
        asked = replace(usual, pad=replace(usual.pad, choice=choice))
        assert load_scenario(written(tmp_path, text), usual) == asked
