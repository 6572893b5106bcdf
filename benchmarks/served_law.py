"""The paper's force law from outside (`examples/ur_rtde_force_law.py`) beside `hybrid-pi` inside the cell.

    pip install ur_rtde
    python -m benchmarks.served_law [--case step-20] [--seed 500]...

For each seed the case is served in real time, the latency from a command of ``speedL`` to the motion of the
set-points is measured in the air, and the example holds the force. Then `hybrid-pi` is run in the same cell,
with that latency and the wire's cycle. A line for each: settling to 1 N and rms error as the score defines
them, and their ratio. Needs a machine that keeps real time; what the server says of its clock stands beside
it.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

from benchmarks.served import serving
from polish_sim.scenario_file import override
from polish_sim.scoring import BATTERY, Entry, Task, choose_cases, measure_row

EXAMPLE = Path(__file__).parents[1] / "examples/ur_rtde_force_law.py"
CYCLE_S = 0.002
TRIALS = 20
FIGURES = ("settling_1n_s", "rms_error_n", "overshoot_n")


def latency(host: str) -> float:
    """Median time from the state a command is answered to, to the begin of the motion it asks for [s]."""
    control, receive, found = RTDEControlInterface(host), RTDEReceiveInterface(host), []
    for trial in range(TRIALS):
        speed = 0.002 if trial % 2 else -0.002
        sent = receive.getTimestamp()
        end = sent + 0.2
        while receive.getTimestamp() < end:
            control.speedL([0.0, 0.0, speed, 0.0, 0.0, 0.0], 1.2, CYCLE_S)
            if receive.getTargetTCPSpeed()[2] * speed > 1e-8:
                found.append(receive.getTimestamp() - CYCLE_S - sent)
                break
            time.sleep(5e-4)
        control.speedStop()
        time.sleep(0.1)
    control.stopScript()
    return float(np.median(found))


def main() -> None:
    """Print the lines."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", default="step-20")
    parser.add_argument("--seed", type=int, action="append", default=[])
    parser.add_argument("--address", default="127.0.0.9")
    asked = parser.parse_args()
    (case,) = choose_cases(BATTERY, [asked.case])
    for seed in asked.seed or (500, 501, 502):
        entry = Entry("outside", "hybrid-pi")
        scenario = Task(case, entry, seed).scenario
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder, "served")
            words = (
                "--score",
                asked.case,
                "--seed",
                str(seed),
                "--address",
                asked.address,
                "--out",
                str(out),
            )
            with serving(*words):
                late = latency(asked.address)
                process = scenario.process
                client = [sys.executable, str(EXAMPLE), "--host", asked.address, "--log", f"{folder}/log.csv",
                          "--force", str(process.contact_force_n), "--seconds", str(process.hold_s + 1.0),
                          "--approach", str(process.approach_speed_m_s)]  # fmt: skip
                subprocess.run(client, check=True)
            outside = json.loads((out / "score.json").read_text())["rows"][0]
        settings = (f"robot.command_latency_s={late}", "simulation.control_every=2")
        same = replace(case, settings=(*case.settings, *settings))
        override(scenario, settings)  # refuses here what does not fit
        inside = measure_row(Task(same, entry, seed))
        told = [f"{name} {outside[name]:.3f} / {inside[name]:.3f} = {outside[name] / inside[name]:.3f}"
                for name in FIGURES if outside[name] and inside[name]]  # fmt: skip
        print(
            f"{asked.case}, seed {seed}, latency {1e3 * late:.1f} ms, outside / inside: {'; '.join(told)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
