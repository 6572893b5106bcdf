"""The paper's force law from outside (`examples/ur_rtde_force_law.py`) beside `hybrid-pi` inside the cell.

    pip install ur_rtde
    python -m benchmarks.served_law [--case step-20] [--seed 500]... [--in-step] [--noise 4]

For each seed the case is served in real time, the latency from a command of ``speedL`` to the motion of the
set-points is measured in the air, and the example holds the force. Then `hybrid-pi` is run in the same cell,
with that latency and the wire's cycle. A line for each: settling to 1 N, rms error and overshoot as the score
defines them, and their ratio; at the end their means. Needs a machine that keeps real time; what the server
says of its clock stands beside it.

``--in-step`` needs no such machine: the example runs in this process with the cell in the place of ur_rtde,
the robot moves on by 2 ms each time it waits, and a command reaches it `WIRE` cycles after the state it
answers. ``--noise`` runs `hybrid-pi` on the same part N times with other noise of the sensor: what two
runs of the same law differ by.
"""

from __future__ import annotations

import argparse
import json
import os
import runpy
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from benchmarks.served import serving
from polish_sim.experiments.assembly import build_cell
from polish_sim.experiments.surface import place_force
from polish_sim.scenario_file import override
from polish_sim.scoring import BATTERY, Entry, Task, choose_cases, measure_row, measured
from polish_sim.spatial import apply
from polish_sim.ur.physics import TICK_S
from polish_sim.ur.robot import SimulatedRobot

EXAMPLE = Path(__file__).parents[1] / "examples/ur_rtde_force_law.py"
TRIALS = 20
WIRE = 1  #: Cycles from a state to the arrival of what answers it, in step
FIGURES = ("settling_1n_s", "rms_error_n", "overshoot_n")
Row = dict[str, object]


def latency(host: str) -> float:
    """Median time from the state a command is answered to, to the begin of the motion it asks for [s]."""
    from rtde_control import RTDEControlInterface
    from rtde_receive import RTDEReceiveInterface

    control, receive, found = RTDEControlInterface(host), RTDEReceiveInterface(host), []
    for trial in range(TRIALS):
        speed = 0.002 if trial % 2 else -0.002
        sent = receive.getTimestamp()
        end = sent + 0.2
        while receive.getTimestamp() < end:
            control.speedL([0.0, 0.0, speed, 0.0, 0.0, 0.0], 1.2, TICK_S)
            if receive.getTargetTCPSpeed()[2] * speed > 1e-8:
                found.append(receive.getTimestamp() - TICK_S - sent)
                break
            time.sleep(5e-4)
        control.speedStop()
        time.sleep(0.1)
    control.stopScript()
    return float(np.median(found))


def words_for(task: Task, folder: str) -> list[str]:
    """What the example gets."""
    process = task.scenario.process
    return ["--log", f"{folder}/log.csv", "--force", str(process.contact_force_n), "--seconds",
            str(process.hold_s + 1.0), "--approach", str(process.approach_speed_m_s)]  # fmt: skip


def over_the_wire(task: Task, address: str) -> tuple[Row, float]:
    """The example's row of the score, served in real time, and its latency [s]."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "served")
        words = ("--score", task.case.name, "--seed", str(task.seed), "--address", address, "--out", str(out))
        with serving(*words):
            late = latency(address)
            client = [sys.executable, str(EXAMPLE), "--host", address, *words_for(task, folder)]
            subprocess.run(client, check=True, preexec_fn=before_others)
        return json.loads((out / "score.json").read_text())["rows"][0], late


def before_others() -> None:
    """As the server does for itself, where the system allows it."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except (AttributeError, OSError):
        print("the client has no priority: expect gaps on a busy machine", flush=True)


class InStep:
    """What the example uses of ur_rtde's two interfaces, on a robot that moves when the example waits."""

    def __init__(self, robot: SimulatedRobot) -> None:
        self.robot = robot
        self.coming: list[tuple[int, Callable[[], None]]] = []

    def tick(self, cycles: int = 1) -> None:
        """Move the robot on."""
        for _ in range(cycles):
            while self.coming and self.coming[0][0] <= self.robot.ticks:
                self.coming.pop(0)[1]()
            self.robot.step()

    def interfaces(self) -> Iterator[tuple[str, SimpleNamespace]]:
        """The modules the example imports."""
        robot, arrives = self.robot, self.coming.append

        def move(pose: list[float], v: float, a: float) -> None:
            robot.movel(np.array(pose), a, v, 0.0, 0.0)
            self.tick()
            while not robot.move_done():
                self.tick()

        def speed(xd: list[float], a: float, _t: float) -> None:
            arrives((robot.ticks + WIRE, lambda: robot.speedl(np.array(xd), a)))

        def stop() -> None:
            self.coming.clear()
            robot.stopl(10.0)
            self.tick(100)

        control = SimpleNamespace(
            zeroFtSensor=robot.zero_ftsensor, speedL=speed, speedStop=stop, moveL=move,
            isProgramRunning=lambda: not robot.stop_reason, initPeriod=lambda: None,
            waitPeriod=lambda _begin: self.tick(), stopScript=lambda: None,
        )  # fmt: skip
        receive = SimpleNamespace(
            getActualTCPPose=lambda: list(robot.actual_tcp_pose),
            getActualTCPSpeed=lambda: list(robot.actual_tcp_speed),
            getActualTCPForce=lambda: list(robot.tcp_force),
            getTimestamp=lambda: robot.time_s,
        )
        yield "rtde_control", SimpleNamespace(RTDEControlInterface=lambda _host: control)
        yield "rtde_receive", SimpleNamespace(RTDEReceiveInterface=lambda _host: receive)


@contextmanager
def instead(modules: dict[str, object], words: list[str]) -> Iterator[None]:
    """These modules and this command line while the block runs."""
    kept, line = {name: sys.modules.get(name) for name in modules}, sys.argv
    sys.modules.update(modules)  # type: ignore[arg-type]
    sys.argv = words
    try:
        yield
    finally:
        sys.argv = line
        for name, module in kept.items():
            sys.modules.pop(name)
            if module is not None:
                sys.modules[name] = module


def in_step(task: Task) -> tuple[Row, float]:
    """The example's row of the score without wire and clock, and its latency [s]."""
    scenario, place = task.scenario, place_force(task.scenario)
    robot = SimulatedRobot(build_cell(scenario, place))
    robot.rig.recording = True
    with tempfile.TemporaryDirectory() as folder:
        step = InStep(robot)
        step.tick(100)  # readings for the sensor's zero
        with instead(dict(step.interfaces()), [str(EXAMPLE), *words_for(task, folder)]):
            runpy.run_path(str(EXAMPLE), run_name="__main__")
    on, path = place.path.process, place.path
    points = apply(place.reach.T_base_work, path.positions_work[on])
    run = robot.rig.result(1.0, points, path.s[on], scenario.process.hold_s)
    return measured(task, place, run), scenario.robot.command_latency_s + WIRE * TICK_S


def noise_again(task: Task, number: int) -> Row:
    """The row of a task whose sensor has other noise: part, place and arm stay."""
    scenario, place = task.scenario, place_force(task.scenario)
    cell = build_cell(scenario, place)
    cell.rng = np.random.default_rng([task.seed, number])
    return measured(task, place, cell.run())


def ratios(above: list[Row], below: list[Row]) -> str:
    """Figures beside each other, means where there are several rows."""
    said = []
    for name in FIGURES:
        a, b = (float(np.mean([row[name] for row in rows])) for rows in (above, below))  # type: ignore[misc]
        said.append(f"{name} {a:.3f} / {b:.3f} = {a / b:.3f}")
    return "; ".join(said)


def main() -> None:
    """Print the lines."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", default="step-20")
    parser.add_argument("--seed", type=int, action="append", default=[])
    parser.add_argument("--address", default="127.0.0.9")
    parser.add_argument("--in-step", action="store_true")
    parser.add_argument("--noise", type=int, default=0)
    asked = parser.parse_args()
    (case,) = choose_cases(BATTERY, [asked.case])
    entry, both, again = Entry("outside", "hybrid-pi"), [], []
    for seed in asked.seed or (500, 501, 502):
        task = Task(case, entry, seed)
        outside, late = in_step(task) if asked.in_step else over_the_wire(task, asked.address)
        settings = (f"robot.command_latency_s={late}", "simulation.control_every=2")
        override(task.scenario, settings)  # refuses here what does not fit
        same = Task(replace(case, settings=(*case.settings, *settings)), entry, seed)
        inside = measure_row(same)
        both.append((outside, inside))
        told = ratios([outside], [inside])
        print(f"{asked.case}, seed {seed}, latency {1e3 * late:.1f} ms, outside / inside: {told}", flush=True)
        others = [noise_again(same, number) for number in range(asked.noise)]
        again += [(other, inside) for other in others]
        for other in others:
            print(f"    inside, other noise / inside: {ratios([other], [inside])}", flush=True)
    print(f"means of {len(both)}, outside / inside: {ratios(*map(list, zip(*both, strict=True)))}")
    for what, pairs in (("outside / inside", both), ("inside, other noise / inside", again)):
        if pairs:
            print(f"{what}, run by run: {spread(pairs)}")


def spread(pairs: list[tuple[Row, Row]]) -> str:
    """How far the ratios of runs go, and how many are within 10%."""
    said = []
    for name in FIGURES:
        ratio = np.array([a[name] / b[name] for a, b in pairs])  # type: ignore[operator]
        near = int(np.sum(np.abs(ratio - 1.0) <= 0.1))
        said.append(f"{name} {ratio.min():.2f} to {ratio.max():.2f}, within 10% {near} of {len(ratio)}")
    return "; ".join(said)


if __name__ == "__main__":
    main()
