"""A user's class from a file: loaded by FILE.py:CLASS, refused with a reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from polish_sim.config import ControllerConfig
from polish_sim.control import CONTROLLERS, build_controller
from polish_sim.errors import InputError

GOOD = """
from __future__ import annotations
from dataclasses import dataclass, field
import numpy as np

@dataclass
class Push:
    cycle_s: float = 0.0
    speed: np.ndarray = field(default_factory=lambda: np.array([0, 0, -0.01, 0, 0, 0]))

    def reset(self, cycle_s):
        self.cycle_s = cycle_s

    def step(self, measurement, target):
        return self.speed

class Deaf:
    def reset(self, cycle_s):
        pass

class Needs:
    def __init__(self, gain):
        pass
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(GOOD, encoding="utf-8")
    return path


def load(name: str) -> object:
    return build_controller(ControllerConfig(name=name))


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
def test_shipped_names_give_shipped_controllers(name: str) -> None:
    assert type(load(name)) is type(CONTROLLERS[name](ControllerConfig()))


def test_a_class_in_a_file_is_made_and_answers(file: Path) -> None:
    made = build_controller(ControllerConfig(name=f"{file}:Push"))
    made.reset(0.002)
    np.testing.assert_array_equal(made.step(None, None), [0, 0, -0.01, 0, 0, 0])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("hybrid", ["unknown controller 'hybrid'", "hybrid-pi", "position", "FILE.py:CLASS"]),
        ("nowhere/mine.py:Push", ["nowhere/mine.py", "does not exist"]),
        ("{file}:Pull", ["Pull", "Push", "Deaf"]),
        ("{file}:Deaf", ["Deaf", "step()"]),
        ("{file}:Needs", ["Needs", "gain"]),
    ],
)
def test_what_cannot_be_loaded_is_named(file: Path, name: str, told: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        load(name.format(file=file))
    for word in told:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("source", "told"),
    [
        ("import no_such_module_here\n", "no_such_module_here"),
        ("class Mine(\n", "SyntaxError"),
        ("raise ValueError('out of gains')\n", "out of gains (broken.py, line 1)"),
        (
            "class Mine:\n    def __init__(self):\n        raise RuntimeError('no licence')\n",
            "no licence (broken.py, line 3)",
        ),
        ("class Mine:\n    step = 3\n    def reset(self, cycle_s):\n        pass\n", "step()"),
    ],
)
def test_a_file_that_fails_says_why(tmp_path: Path, source: str, told: str) -> None:
    path = tmp_path / "broken.py"
    path.write_text(source, encoding="utf-8")
    with pytest.raises(InputError, match=r"broken\.py") as caught:
        load(f"{path}:Mine")
    assert told in str(caught.value)
