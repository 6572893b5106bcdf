"""A small machine that runs our URScript programs: blocks are checked, statements executed, motions
recorded."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.spatial import from_pose

Array = NDArray[np.float64]
OPENERS = ("def ", "thread ", "if ", "while ")
STEP_S = 0.002


class Halted(Exception):
    """The program stopped itself."""


class Motion(NamedTuple):
    """A finished move."""

    T_base_tool: Array
    speed: float
    blend: float
    pressing: bool
    spindle: bool


class Pressing(NamedTuple):
    """One call of force_mode."""

    T_base_task: Array
    T_base_tool: Array
    selection: list[float]
    wrench: list[float]
    kind: int
    limits: list[float]


class Machine:
    """Where the tool is and what was asked of it."""

    def __init__(self, contact_after_s: float = 0.05) -> None:
        self.contact_after_s = contact_after_s
        self.T_base_tool = np.eye(4)
        self.motions: list[Motion] = []
        self.pressings: list[Pressing] = []
        self.events: list[str] = []
        self.thread: Generator[None] | None = None
        self.force_mode_on = False
        self.pressed_for_s = 0.0
        self.spindle = False
        self.scope: dict[str, Any] = {}

    def run(self, text: str) -> None:
        """Check the blocks, translate to Python and execute."""
        check_blocks(text)
        commands = ("movej", "movel", "force_mode", "sync", "force", "kill", "halt", "end_force_mode")
        self.scope |= {name: getattr(self, name) for name in commands} | {"run": self.run_thread}
        self.scope |= {
            name: self._noted(name) for name in ("set_tcp", "set_payload", "zero_ftsensor", "sleep", "popup")
        }
        self.scope |= {f"force_mode_set_{name}": self._noted(name) for name in ("damping", "gain_scaling")}
        self.scope |= {"pose": lambda *v: from_pose(v), "pose_trans": lambda a, b: a @ b, "G": self.scope}
        self.scope |= {"get_actual_tcp_pose": lambda: self.T_base_tool, "get_steptime": lambda: STEP_S}
        self.scope["set_standard_digital_out"] = self.switch
        name = re.search(r"^def (\w+)\(\):", text, flags=re.MULTILINE)
        assert name is not None
        exec(compile(translate(text), "path.script", "exec"), self.scope)
        self.scope[name[1]]()

    def movel(self, target: Array, a: float, v: float, r: float = 0.0) -> None:
        self.T_base_tool = target
        if self.thread is not None:
            next(self.thread)
        self.motions.append(Motion(target, v, r, self.force_mode_on, self.spindle))

    def movej(self, target: Array, a: float, v: float) -> None:
        self.movel(target, a, v)

    def force_mode(
        self, task: Array, selection: list[float], wrench: list[float], kind: int, limits: list[float]
    ) -> None:
        self.force_mode_on = True
        self.pressings.append(Pressing(task, self.T_base_tool, selection, wrench, kind, limits))

    def end_force_mode(self) -> None:
        assert self.thread is None, "force mode would be switched on again by the thread"
        self.force_mode_on = False
        self.pressed_for_s = 0.0
        self.events.append("end_force_mode")

    def sync(self) -> None:
        self.pressed_for_s += STEP_S
        if self.thread is not None:
            next(self.thread)

    def force(self) -> float:
        return float(self.scope["force_n"]) if self.pressed_for_s > self.contact_after_s else 0.0

    def run_thread(self, thread: Generator[None]) -> str:
        self.thread = thread
        self.events.append("run")
        return "handle"

    def kill(self, handle: str) -> None:
        assert handle == "handle"
        self.thread = None
        self.events.append("kill")

    def switch(self, output: int, on: bool) -> None:
        self.spindle = on
        self.events.append(f"spindle {on}")

    def halt(self) -> None:
        raise Halted

    def _noted(self, name: str) -> Callable[..., None]:
        return lambda *values, **words: self.events.append(name)


def check_blocks(text: str) -> None:
    """Every block ends at the depth it began, every bracket closes on its line."""
    open_blocks: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        code = line.split("#", 1)[0].rstrip()
        if not code:
            continue
        depth, words = len(code) - len(code.lstrip()), code.strip()
        for left, right in ("()", "[]"):
            assert words.count(left) == words.count(right), f"line {number}: {words}"
        if words == "end":
            assert open_blocks, f"line {number} ends nothing"
            assert open_blocks.pop() == depth, f"line {number} ends a block of another depth"
            continue
        assert depth == 2 * len(open_blocks), (
            f"line {number} stands {depth} deep in {len(open_blocks)} blocks"
        )
        if words.startswith(OPENERS):
            assert words.endswith(":"), f"line {number}: {words}"
            open_blocks.append(depth)
    assert not open_blocks


def translate(text: str) -> str:
    """URScript to Python; only what our programs use."""
    lines, in_thread = [], None
    for raw in text.splitlines():
        line = raw.split("#", 1)[0].rstrip()
        depth = len(line) - len(line.lstrip())
        if line.strip() == "end":
            in_thread = None if in_thread == depth else in_thread
            continue
        if line.strip().startswith("thread "):
            in_thread = depth
            line = line.replace("thread ", "def ")
        if in_thread is not None:
            line = line.replace("sync()", "yield")
        line = re.sub(r"\bp\[([^\]]*)\]", r"pose(\1)", line)
        line = re.sub(r"\bglobal (\w+) = (.*)", r"G['\1'] = \2", line)
        line = re.sub(r"\brun (\w+\(\))", r"run(\1)", line)
        line = re.sub(r"\bkill (\w+)", r"kill(\1)", line)
        lines.append(re.sub(r"^(\s*)halt$", r"\1halt()", line))
    return "\n".join(lines)
