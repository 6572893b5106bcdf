"""A user's Python controller in the compiled loop: the same as the shipped law, and stopped when it fails."""

import os
import signal

import numpy as np
import pytest

from polish_sim.cell import Silent
from polish_sim.errors import InputError
from polish_sim.log import RETRACT_PHASE
from tests.cell.cells import Law, on_plane

WRAPS = """
from polish_sim.config import ControllerConfig
from polish_sim.control import CONTROLLERS

class Mine:
    def __init__(self):
        self.inner = CONTROLLERS["{name}"](ControllerConfig())
        self.reset, self.step = self.inner.reset, self.inner.step
"""

FAILS = """
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
        ("np.full(6, np.nan)", "not finite"),
        ("np.zeros((6, 1))", "shape (6, 1), expected (6,)"),
        ("None", "returned None, expected (6,)"),
        ("'fast'", "returned 'fast', expected (6,)"),
        ("{}['gain']", "the controller raised an error: KeyError: 'gain' (mine.py, line "),
    ],
)
def test_a_failing_step_is_a_protective_stop_with_its_reason(tmp_path, answer, told):
    run = run_with(tmp_path, FAILS.format(answer=answer))
    assert told in str(run.stop_reason)
    assert run.safety.protective_stop_time_s == pytest.approx(0.9)
    assert run.safety.retracted is True
    assert run.trace.phase[899] != 3
    assert set(run.trace.phase[900:]) == {3}
    assert len(run.log) == run.steps


def test_the_controller_is_called_once_a_cycle_with_the_clock_and_cycle_it_was_told():
    calls = []

    def step(measurement, _target):
        calls.append((measurement.time, measurement.cycle))
        return [0.0, 0.0, -0.005, 0, 0, 0]  # a list of numbers will do

    watch = Law(step)
    run = on_plane("simulation.control_every=4", controller=watch).run()
    times, cycles = np.array(calls).T
    assert watch.cycle_s == 0.004
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

    law = Law(step)
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
    run = on_plane(controller=Law(stuck)).run(Listening())
    assert len(said) == 1
    assert "Ctrl-C again" in said[0]
    assert (run.interrupted, run.stop_reason, run.steps) == (True, None, 102)
    assert signal.getsignal(signal.SIGINT) is before
    assert signal.getsignal(signal.SIGALRM) is signal.SIG_DFL
