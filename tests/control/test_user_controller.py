"""A user's class from a file: loaded by FILE.py:CLASS, refused with a reason."""

import re
import tomllib

import pytest

from polish_sim.analysis.run_record import once_more
from polish_sim.config import ControllerConfig
from polish_sim.control import build_controller
from polish_sim.control.laws import law_parameters
from polish_sim.errors import LARGEST, ConfigError, InputError, PolishSimError
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.scenario_file import load_scenario, merge, override, to_toml

GOOD = """
from __future__ import annotations
from dataclasses import dataclass, field
import numpy as np

@dataclass
class Push:
    speed: np.ndarray = field(default_factory=lambda: np.array([0, 0, -0.01, 0, 0, 0]))

    def reset(self, cycle_s):
        pass

    def step(self, measurement, target):
        return self.speed

class Deaf:
    def reset(self, cycle_s):
        pass

class Needs:
    def __init__(self, gain):
        pass

class Tuned(Push):
    ranges = {"gain": (0.001, 0.1)}

    def __init__(self, gain=0.01, sign=1, mode="press", late=False):
        super().__init__()
        self.gain, self.sign, self.mode, self.late = gain, sign, mode, late
"""

FAILS = "class Mine:\n    def __init__(self):\n        raise RuntimeError('no licence')\n"


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(GOOD, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("source", "name", "told"),
    [
        (GOOD, "hybrid", "Did you mean 'hybrid-pi'"),
        (GOOD, "{file}:Pull", "Push, Deaf, Needs, Tuned"),
        (GOOD, "{file}:Deaf", "step()"),
        (GOOD, "{file}:Needs", "gain"),
        ("import no_such_module_here\n", "{file}:Mine", "no_such_module_here"),
        ("class Mine(\n", "{file}:Mine", "SyntaxError"),
        (FAILS, "{file}:Mine", "no licence (mine.py, line 3)"),
    ],
)
def test_what_cannot_be_loaded_says_why(file, source, name, told):
    file.write_text(source, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(told)):
        build_controller(ControllerConfig(name=name.format(file=file)))


def tuned(file, **own):
    return build_controller(ControllerConfig(name=f"{file}:Tuned", own=own))


@pytest.mark.parametrize(
    ("own", "told"),
    [
        ({"gian": 0.02}, "Did you mean 'gain'?"),
        ({"gain": 0.2}, "gain' = 0.2 is outside 0.001 to 0.1"),
        ({"sign": 0.5}, "own.sign' must be a whole number"),
        ({"late": 1}, "own.late' must be true or false"),
        ({"mode": 3}, "own.mode' must be text"),
    ],
)
def test_wrong_parameters_are_refused_by_name(file, own, told):
    with pytest.raises(PolishSimError, match=re.escape(told)):
        tuned(file, **own)
    with pytest.raises(InputError, match=r"controller\.own\.\w+ "):
        build_controller(ControllerConfig(own=own))


@pytest.mark.parametrize("ranges", ["[1]", "{'gain': ('a', 'b')}", "{'gain': 3}", "{'gain': (0.1, 0.001)}"])
def test_ranges_that_are_none_are_refused_by_name(file, ranges):
    file.write_text(GOOD.replace('{"gain": (0.001, 0.1)}', ranges), encoding="utf-8")
    with pytest.raises(InputError, match=r"range.*mine\.py:Tuned.*\(least, most\)"):
        law_parameters(f"{file}:Tuned")


def test_a_class_declares_its_parameters_which_are_set_like_other_keys_and_kept_in_the_config(file, tmp_path):
    made = tuned(file, gain=0.02, mode="glide", late=True)
    assert (made.gain, made.sign, made.mode, made.late) == (0.02, 1, "glide", True)
    known = law_parameters(f"{file}:Tuned")
    assert list(known) == ["gain", "sign", "mode", "late"]
    ranges = {name: (p.default, p.metadata["low"], p.metadata["high"]) for name, p in known.items()}
    assert ranges["gain"] == (0.01, 0.001, 0.1)
    assert ranges["sign"] == (1, -LARGEST, LARGEST)
    usual, written = default_scenario("force"), tmp_path / "config.toml"
    own = ["controller.own.gain=0.02", "controller.own.late=true"]
    chosen = override(usual, [f"controller.name={file}:Tuned", *own])
    written.write_text(to_toml(chosen), encoding="utf-8")
    assert load_scenario(written, usual) == chosen
    assert chosen.controller.own == {"gain": 0.02, "late": True}
    assert "--set controller.own.gain=0.02" in once_more(chosen, usual)
    hash(chosen)
    refused = {"own.gain=[1, 2]": r"own\.gain' must be a number, text", "own=3": r"own' is a section"}
    for value, said in refused.items():
        with pytest.raises(ConfigError, match=said):
            override(usual, [f"controller.{value}"])


def test_an_object_is_run_as_it_is_and_the_config_says_how_to_make_it_again(file):
    made = tuned(file, gain=0.02)
    scenario = override(default_scenario("arc"), ["process.feed_m_s=0.4", "process.max_feed_s=0.2"])
    by_object = run_experiment(scenario, controller=made)
    config = by_object.scenario.controller
    assert (config.name, config.own["gain"]) == (f"{file}:Tuned", 0.02)
    again = run_experiment(merge(scenario, tomllib.loads(to_toml(by_object.scenario)), ""))
    assert again.log["tcp_position_m"].tobytes() == by_object.log["tcp_position_m"].tobytes()
    with pytest.raises(InputError, match=r"'object' lacks the method reset\(\)"):
        run_experiment(scenario, controller=object())
