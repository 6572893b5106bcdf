"""A user's class from a file: loaded by FILE.py:CLASS or refused; in the compiled loop."""

import os
import re
import signal
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest

from polish_sim.cell import Silent
from polish_sim.config import ControllerConfig
from polish_sim.control import build_controller
from polish_sim.control.laws import law_parameters
from polish_sim.errors import LARGEST, ConfigError, InputError, PolishSimError
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.experiments.registry import once_more
from polish_sim.log import RETRACT_PHASE
from polish_sim.scenario_file import load_scenario, merge, override, to_toml
from tests.cell.cells import on_plane

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

RANGES = '{"gain": (0.001, 0.1)}'
NO_RANGES = "[1]", "{'gain': ('a', 'b')}", "{'gain': 3}", "{'gain': (0.1, 0.001)}"
FAILS = "class Mine:\n    def __init__(self):\n        raise RuntimeError('no licence')\n"


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(GOOD, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("source", "name", "told"),
    [
        (GOOD, "hybrid", "Did you mean 'hybrid-pi'"), (GOOD, "{file}:Pull", "Push, Deaf, Needs, Tuned"),
        (GOOD, "{file}:Deaf", "step()"), (GOOD, "{file}:Needs", "gain"),
        ("import no_such_module_here\n", "{file}:Mine", "no_such_module_here"),
        ("class Mine(\n", "{file}:Mine", "SyntaxError"),
        (FAILS, "{file}:Mine", "no licence (mine.py, line 3)"),
        *((GOOD.replace(RANGES, ranges), "{file}:Tuned", "(least, most)") for ranges in NO_RANGES),
    ],
)  # fmt: skip
def test_what_cannot_be_loaded_says_why(file, source, name, told):
    file.write_text(source, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(told)):
        build_controller(ControllerConfig(name=name.format(file=file)))


def tuned(file, **own):
    return build_controller(ControllerConfig(name=f"{file}:Tuned", own=own))


@pytest.mark.parametrize(
    ("own", "told"),
    [
        ({"gian": 0.02}, "Did you mean 'gain'?"), ({"gain": 0.2}, "gain' = 0.2 is outside 0.001 to 0.1"),
        ({"sign": 0.5}, "own.sign' must be a whole number"), ({"late": 1}, "own.late' must be true or false"),
        ({"mode": 3}, "own.mode' must be text"),
    ],
)  # fmt: skip
def test_wrong_parameters_are_refused_by_name(file, own, told):
    with pytest.raises(PolishSimError, match=re.escape(told)):
        tuned(file, **own)
    with pytest.raises(InputError, match=r"controller\.own\.\w+ "):
        build_controller(ControllerConfig(own=own))


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
    assert "--set controller.own.gain=0.02" in once_more(chosen)
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


WRAPS = """
from polish_sim.config import ControllerConfig
from polish_sim.control import CONTROLLERS

class Mine:
    def __init__(self):
        self.inner = CONTROLLERS["{name}"](ControllerConfig())
        self.reset, self.step = self.inner.reset, self.inner.step
"""

FAILS_LATE = """
import numpy as np

class Mine:
    def reset(self, cycle_s):
        self.cycle_s, self.calls = cycle_s, 0

    def step(self, measurement, target):
        self.calls += 1
        return {answer} if measurement.time >= 0.9 else np.zeros(6)
"""


def run_of(controller, *changes):
    noisy = ["sensor.force_noise_n=0.5", "sensor.force_bias_n=2"]
    return on_plane(*noisy, f"controller.name={controller}", *changes, slide=0.004, lift=0.005).run()


def run_with(folder, source, *changes):
    path = folder / "mine.py"
    path.write_text(source, encoding="utf-8")
    return run_of(f"{path}:Mine", *changes)


@pytest.mark.parametrize(("name", "every"), [("hybrid-pi", 2), ("position", 1), ("force-mode", 1)])
def test_a_class_that_wraps_a_shipped_law_gives_its_run(tmp_path, name, every):
    cycle = f"simulation.control_every={every}"
    mine, shipped = run_with(tmp_path, WRAPS.format(name=name), cycle), run_of(name, cycle)
    assert mine.stop_reason is None
    assert all(np.array_equal(mine.log[column], shipped.log[column]) for column in mine.log.names)


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ("np.full(6, np.nan)", "not finite"), ("np.zeros((6, 1))", "shape (6, 1), expected (6,)"),
        ("None", "returned None, expected (6,)"), ("'fast'", "returned 'fast', expected (6,)"),
        ("{}['gain']", "the controller raised an error: KeyError: 'gain' (mine.py, line "),
    ],
)  # fmt: skip
def test_a_failing_step_is_a_protective_stop_with_its_reason(tmp_path, answer, told):
    run = run_with(tmp_path, FAILS_LATE.format(answer=answer))
    assert told in str(run.stop_reason)
    assert run.safety.protective_stop_time_s == pytest.approx(0.9)
    assert run.safety.retracted is True
    assert run.trace.phase[899] != 3
    assert set(run.trace.phase[900:]) == {3}
    assert len(run.log) == run.steps


def test_the_controller_is_called_once_a_cycle_with_the_clock_and_cycle_it_was_told():
    calls, told = [], []

    def step(measurement, _target):
        calls.append((measurement.time, measurement.cycle))
        return [0.0, 0.0, -0.005, 0, 0, 0]  # a list of numbers will do

    watch = SimpleNamespace(step=step, reset=told.append)
    run = on_plane("simulation.control_every=4", controller=watch).run()
    times, cycles = np.array(calls).T
    assert set(told) == {0.004}
    np.testing.assert_allclose(cycles, 0.004)
    np.testing.assert_allclose(times, 0.004 * np.arange(len(times)), atol=1e-12)
    steps = int(np.sum(run.trace.phase < RETRACT_PHASE))
    assert len(times) == steps // 4 + 1  # the cycle of the stop is the last
    assert run.log["command_twist"][100, 2] == pytest.approx(-0.005)


def test_a_controller_that_cannot_be_reset_is_named_and_an_interrupt_inside_a_step_is_no_error():
    def step(measurement, target):
        if measurement.time > 0.5:
            raise KeyboardInterrupt
        return np.zeros(6)

    law = SimpleNamespace(step=step, reset=lambda cycle_s: None)
    run = on_plane(controller=law).run()
    assert (run.interrupted, run.stop_reason, run.steps) == (True, None, 502)
    law.reset = lambda cycle_s: {}[f"no gains for {cycle_s} s"]
    with pytest.raises(InputError, match=r"reset\(\).*no gains for 0.001 s"):
        on_plane(controller=law)


@pytest.mark.parametrize("again", [False, True], ids=["once", "twice"])
def test_an_endless_controller_is_stopped_by_ctrl_c(monkeypatch, again):
    monkeypatch.setattr("polish_sim.cell.observer.PATIENCE_S", 30.0 if again else 0.05)
    said = []

    def stuck(measurement, target):
        if measurement.time > 0.1:
            os.kill(os.getpid(), signal.SIGINT)
            while True:
                if again and said:
                    os.kill(os.getpid(), signal.SIGINT)
        return np.zeros(6)

    class Listening(Silent):
        def stage(self, text):
            said.append(text)

    before = signal.getsignal(signal.SIGINT)
    run = on_plane(controller=SimpleNamespace(step=stuck, reset=lambda cycle_s: None)).run(Listening())
    assert ["Ctrl-C again" in text for text in said] == [True]
    assert (run.interrupted, run.stop_reason, run.steps) == (True, None, 102)
    assert signal.getsignal(signal.SIGINT) is before
    assert signal.getsignal(signal.SIGALRM) is signal.SIG_DFL
