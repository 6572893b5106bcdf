"""Sweeps measured: rate beside independent processes, equal rows on every engine, kills, memory.

``python -m benchmarks.sweeps rate|engines|kills|memory``; each takes its own folder under the system's
temporary one.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from polish_sim.row_file import Rows

PROGRAM = [sys.executable, "-c", "from polish_sim.cli.main import app; app()"]
ALONE = """
import sys
from dataclasses import replace
from polish_sim.experiments.registry import default_scenario, run_experiment
usual = default_scenario("force")
for seed in range(int(sys.argv[1]), int(sys.argv[2])):
    run_experiment(replace(usual, seed=seed))
"""
UNLIKE = ("wall_s", "loop_wall_s", "host")  #: Columns in which equal runs differ
SHORT = ("--set", "process.max_feed_s=0.05", "--set", "process.feed_m_s=0.1")
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1"}


def sweep(folder: Path, *words: str, check: bool = True) -> float:
    """Run a sweep into a folder; wall time [s]."""
    begun = time.perf_counter()
    command = [*PROGRAM, "sweep", *words, "--out", str(folder)]
    subprocess.run(
        command, check=check, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=ENVIRONMENT
    )
    return time.perf_counter() - begun


def rows_of(folder: Path) -> list[dict[str, Any]]:
    return [row for _, row in Rows(folder).read()]


def rate(folder: Path, runs: int) -> None:
    """Seeds of ``run force`` as a sweep on two processes, beside two processes that know nothing of each
    other."""
    sweep(folder / "warm", "force", "--seeds", "2")
    for turn in range(2):
        begun, half = time.perf_counter(), runs // 2
        alone = [subprocess.Popen([sys.executable, "-c", ALONE, str(a), str(a + half)], env=ENVIRONMENT)
                 for a in (0, half)]  # fmt: skip
        for process in alone:
            process.wait()
        apart = time.perf_counter() - begun
        together = sweep(folder / f"rate-{turn}", "force", "--seeds", str(runs), "--workers", "2")
        rows = rows_of(folder / f"rate-{turn}")
        wall, loop = (np.array([row[name] for row in rows]) for name in ("wall_s", "loop_wall_s"))
        print(
            f"{runs} runs: two processes {apart:.1f} s, sweep {together:.1f} s, ratio of rates "
            f"{apart / together:.3f}"
        )
        print(f"a run: {1e3 * np.median(wall):.0f} ms, of which simulation {1e3 * np.median(loop):.0f} ms; "
              f"allowed {1e3 * (1.3 * np.median(loop) + 0.05):.0f} ms", flush=True)  # fmt: skip


@contextmanager
def scheduler(port: int = 8797, workers: int = 2) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A Dask scheduler with workers of one thread; the first process is the scheduler."""
    address, quiet = f"tcp://127.0.0.1:{port}", {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "dask"]
    begun = [
        subprocess.Popen(
            [*dask, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"],
            env=ENVIRONMENT,
            **quiet,
        )
    ]  # type: ignore[call-overload]
    begun += [
        subprocess.Popen(
            [
                *dask,
                "worker",
                address,
                "--nthreads",
                "1",
                "--no-dashboard",
                "--no-nanny",
                "--local-directory",
                tempfile.gettempdir(),
            ],
            env=ENVIRONMENT,
            **quiet,
        )  # type: ignore[call-overload]
        for _ in range(workers)
    ]
    try:
        yield address, begun
    finally:
        for process in begun:
            process.kill()
            process.wait()


def comparable(folder: Path) -> dict[str, str]:
    """Rows by hash, without what differs between equal runs; an error where one is there twice."""
    rows = rows_of(folder)
    known = {
        row["config_hash"]: json.dumps({k: v for k, v in row.items() if k not in UNLIKE}) for row in rows
    }
    if len(known) != len(rows):
        raise SystemExit(f"{len(rows) - len(known)} rows are there twice")
    return known


def engines(folder: Path, runs: int) -> None:
    """The same sweep here, on a local Dask cluster, and on a scheduler."""
    words = ("force", "--vary", "controller.force_p_m_sn=0.002:0.008:log4", "--seeds", str(max(1, runs // 4)))
    sweep(folder / "local", *words)
    sweep(folder / "dask", *words, "--on", "dask")
    with scheduler() as (address, _):
        sweep(folder / "tcp", *words, "--on", address)
    local = comparable(folder / "local")
    for name in ("dask", "tcp"):
        print(
            f"{name}: {len(local)} rows, byte for byte those of local: {comparable(folder / name) == local}",
            flush=True,
        )


def kills(folder: Path, count: int) -> None:
    """Kill a worker, the scheduler or the command at a random moment of a sweep, and let it resume, ``count``
    times."""
    draw = random.Random(0)
    words = ("arc", "--vary", "sensor.force_noise_n=0:1:lin100", "--seeds", str(max(1, count // 3)), *SHORT)
    sweep(folder / "whole", *words)
    total = len(rows_of(folder / "whole"))
    victims = {"worker": 0, "scheduler": 0, "command": 0}
    for number in range(count):
        victim = list(victims)[number % 3]
        victims[victim] += 1
        if lines(folder / "killed") > 0.95 * total:
            raise SystemExit(f"all is done after {number} kills: raise --count's rows")
        with scheduler(8700 + number) as (address, processes):
            on = ("--on", address) if victim == "scheduler" or number % 2 else ("--workers", "2")
            asked = ["sweep", *words, *on, "--out", str(folder / "killed")]
            command = subprocess.Popen([*PROGRAM, *asked], stderr=subprocess.DEVNULL, env=ENVIRONMENT,
                                       stdout=subprocess.DEVNULL)  # fmt: skip
            begun = lines(folder / "killed")
            while lines(folder / "killed") < begun + 5 and command.poll() is None:
                time.sleep(0.02)
            time.sleep(draw.uniform(0.0, 0.5))
            target = command.pid
            if victim == "scheduler":
                target = processes[0].pid
            elif victim == "worker":
                target = (
                    processes[1].pid if "--on" in on else draw.choice(children(command.pid) or [command.pid])
                )
            os.kill(target, signal.SIGKILL)
            time.sleep(draw.uniform(0.0, 1.0))
            if victim == "worker" and command.poll() is None:
                command.send_signal(signal.SIGINT)
            command.wait(120)
        print(f"{number + 1}: {victim} killed, {len(comparable(folder / 'killed'))} rows", flush=True)
    sweep(folder / "killed", *words)
    same = comparable(folder / "killed") == comparable(folder / "whole")
    print(f"killed {victims}: {len(rows_of(folder / 'killed'))} rows, those of a sweep that was not: {same}")
    print(f"processes left: {len(left_over(folder))}")


def lines(folder: Path) -> int:
    file = folder / "rows.jsonl"
    return file.read_bytes().count(b"\n") if file.exists() else 0


def children(pid: int) -> list[int]:
    """Processes of the pool of a command, by the words they were started with."""
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in found if b"popen_loky" in Path(f"/proc/{child}/cmdline").read_bytes()]


def left_over(folder: Path) -> list[int]:
    """Processes that still know a folder."""
    known = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if str(folder).encode() in entry.read_bytes():
                known.append(int(entry.parent.name))
        except OSError:
            continue
    return known


def memory(folder: Path, runs: int) -> None:
    """Memory of the command while many short runs come in."""
    words = ("arc", "--vary", "sensor.force_noise_n=0:1:lin100", "--seeds", str(max(1, runs // 100)), *SHORT)
    command = subprocess.Popen([*PROGRAM, "sweep", *words, "--out", str(folder / "many")], env=ENVIRONMENT,
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
    begun, told = time.perf_counter(), 0
    while command.poll() is None:
        done = lines(folder / "many")
        if done >= told + runs // 10:
            told = done
            status = Path(f"/proc/{command.pid}/status").read_text()
            now, most = (int(status.split(f"{name}:")[1].split()[0]) / 1e3 for name in ("VmRSS", "VmHWM"))
            print(
                f"{done} rows in {time.perf_counter() - begun:.0f} s: {now:.0f} MB, at most {most:.0f} MB",
                flush=True,
            )
        time.sleep(0.2)
    import pyarrow.parquet as parquet

    begun = time.perf_counter()
    table = parquet.read_table(folder / "many" / "runs.parquet")
    print(f"runs.parquet: {table.num_rows} rows read in {time.perf_counter() - begun:.3f} s")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure one of them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sweeps", description=__doc__)
    measured = {
        "rate": (rate, 200),
        "engines": (engines, 24),
        "kills": (kills, 30),
        "memory": (memory, 10_000),
    }
    parser.add_argument("what", choices=measured)
    parser.add_argument("--count", type=int, help="runs, or kills; default 200, 24, 30, 10000")
    given = parser.parse_args(arguments)
    measure, usual = measured[given.what]
    with tempfile.TemporaryDirectory(prefix="polish-sim-sweeps-") as folder:
        measure(Path(folder), given.count or usual)


if __name__ == "__main__":
    main()
