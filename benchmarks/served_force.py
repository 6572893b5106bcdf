"""Force mode of the served robot, asked for by the unmodified ur_rtde wheel as its own test and example do.

    pip install ur_rtde
    python -m benchmarks.served_force [--address 127.0.0.6]

In free air: 10 N down for 2 s, then 10 N up for 2 s, from the joints and to the pose of ur_rtde's
test/main.cpp. On the plate, as it is and with springs ten times as stiff: 20 N down from 10 mm above, with
the example's limits of 1.5 m/s.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rtde_control
import rtde_receive

from benchmarks.served import serving
from polish_sim.log import PROCESS_PHASE

JOINTS = [-1.54, -1.83, -2.28, -0.59, 1.60, 0.023]
GIVEN = np.array([-0.117025, -0.435893, 0.150533, -0.0124127, 3.11199, -0.0180484])
SHARE = 0.05  #: Of 1 + the value: how far the pose may be off, as in that test
LIMITS = [2.0, 2.0, 1.5, 1.0, 1.0, 1.0]
STIFF = ("1", "10")


def press(control: rtde_control.RTDEControlInterface, forces: Sequence[float], cycles: int = 1000) -> None:
    """Vertical forces [N] in turn, each for a number of cycles of 2 ms."""
    for force in forces:
        for _ in range(cycles):
            begin = control.initPeriod()
            control.forceMode([0.0] * 6, [0, 0, 1, 0, 0, 0], [0, 0, force, 0, 0, 0], 2, LIMITS)
            control.waitPeriod(begin)
    control.forceModeStop()


def in_air(host: str, zeroed: bool) -> bool:
    """The test; whether the arm ends where it says."""
    control, receive = rtde_control.RTDEControlInterface(host), rtde_receive.RTDEReceiveInterface(host)
    control.setTcp([0.0] * 6)
    control.moveJ(JOINTS)
    time.sleep(0.5)
    if zeroed:
        control.zeroFtSensor()
    seen, ended = list[tuple[float, float]](), threading.Event()

    def watch() -> None:
        while not ended.wait(0.004):
            seen.append((receive.getActualTCPPose()[2], receive.getActualTCPSpeed()[2]))

    thread = threading.Thread(target=watch)
    thread.start()
    press(control, (-10.0, 10.0))
    end = np.array(receive.getActualTCPPose())
    ended.set()
    thread.join()
    place, speed = np.array(seen).T
    good = bool(np.all(np.abs(end - GIVEN) < SHARE * (1.0 + np.maximum(np.abs(end), np.abs(GIVEN)))))
    off = np.abs(end - GIVEN)[:3].max()
    print(
        f"free air, sensor {'zeroed' if zeroed else 'as it is'}: {1e3 * (place[0] - place.min()):.1f} mm "
        f"down and up, at most {1e3 * np.abs(speed).max():.1f} mm/s, {1e3 * off:.1f} mm from the pose of "
        f"the test: {'passed' if good else 'MISSED'}"
    )
    control.stopScript()
    return good


def on_plate(host: str) -> None:
    """Land from 10 mm above and press 20 N for 6 s."""
    control, receive = rtde_control.RTDEControlInterface(host), rtde_receive.RTDEReceiveInterface(host)
    time.sleep(0.5)
    control.zeroFtSensor()
    assert control.moveUntilContact([0.0, 0.0, -0.01, 0.0, 0.0, 0.0])
    above = receive.getActualTCPPose()
    above[2] += 0.01
    control.moveL(above, 0.05, 0.5)
    time.sleep(0.5)
    control.zeroFtSensor()
    press(control, [-20.0], 3000)
    control.moveL(above, 0.05, 0.5)
    control.stopScript()


def main() -> None:
    """Print the results."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--address", default="127.0.0.6")
    host = parser.parse_args().address
    with tempfile.TemporaryDirectory() as folder:
        words = ("--part", "plate", "--address", host)
        with serving(*words, "--air", "--out", f"{folder}/air"):
            good = [in_air(host, zeroed) for zeroed in (False, True)]
        for scale in STIFF:
            out = Path(folder, scale)
            stiff = ("--set", f"head.spring_scale={scale}", "--set", "simulation.timestep_s=0.0005")
            with serving(*words, *stiff, "--out", str(out)):
                on_plate(host)
            with np.load(out / "log.npz") as log:
                t, force, phase = (log[name] for name in ("time_s", "normal_force_n", "phase"))
            work = np.flatnonzero(phase == PROCESS_PHASE)
            held = force[work[(t[work] > t[work[0]] + 2.0) & (t[work] < t[work[-1]] - 0.2)]]
            print(
                f"plate, springs x {scale}: exact force at most {force.max():.1f} N, from 2 s on "
                f"{held.mean():.2f} N, rms of the deviation {held.std():.2f} N"
            )
    raise SystemExit(not all(good))


if __name__ == "__main__":
    main()
