"""A small job ended by SIGKILL, SIGTERM or SIGINT at random simulated moments and resumed, beside the job
left alone.

    python -m benchmarks.job_killed [--count 20] [--seed 500]

A line for each: when it was killed, how many pieces the pass was run in, removal summed over the region
beside the job that ran through, share of the region that lost less than half as much as there, and more than
1.5 times as much.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from polish_sim.log import RemovalMap, read_removal

JOB = """
part = "plate"
[cell]
safety.proof = "none"
[[setup]]
regions = ["box:0,0,-10,60,60,100"]
[[setup.pass]]
plan.pattern = "raster"
plan.stepover_m = 0.02
process.feed_m_s = 0.02
"""
PASS = "setup_1/region_1/pass_1"
WAYS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
COMMAND = (sys.executable, "-c", "from polish_sim.cli import start; start()", "job")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=500)
    asked = parser.parse_args()
    rng = random.Random(asked.seed)
    with TemporaryDirectory() as name:
        folder = Path(name)
        file = folder / "job.toml"
        file.write_text(JOB)
        run(file, folder / "whole")
        lasts = json.loads((folder / "whole" / "job.json").read_text())["cycle_time_s"]
        for number in range(asked.count):
            out, after = folder / f"killed_{number}", rng.uniform(0.0, lasts)
            process = subprocess.Popen([*COMMAND, str(file), "--out", str(out)], stderr=subprocess.DEVNULL,
                                       stdout=subprocess.DEVNULL)  # fmt: skip
            while process.poll() is None and len(list(out.glob(f"{PASS}/pieces/0-*/0*.npz"))) < after:
                time.sleep(0.02)
            process.send_signal(how := rng.choice(WAYS))
            process.wait()
            run(file, out, *(["--resume"] if (out / "job.toml").is_file() else []))
            say(how.name, after, removal_of(folder / "whole"), removal_of(out), out)


def run(file: Path, out: Path, *more: str) -> None:
    """Run or resume the job."""
    done = subprocess.run(
        [*COMMAND, str(file), "--out", str(out), *more], check=False, capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(done.stderr)


def removal_of(out: Path) -> RemovalMap:
    """Of its one pass."""
    return read_removal(out / PASS / "run" / "removal.npz")


def say(how: str, after: float, one: RemovalMap, two: RemovalMap, out: Path) -> None:
    """One line."""
    pieces = json.loads((out / "job.json").read_text())["passes"][0]["pieces"]
    polished = one.exposure > 0.1 * one.mean
    ratio, areas = two.exposure[polished] / one.exposure[polished], one.areas[polished]
    print(
        f"{how} at {after:5.1f} simulated s, {pieces} piece(s): removal {two.mean / one.mean:.3f}, "
        f"under half {areas[ratio < 0.5].sum() / areas.sum():.4f}, "
        f"over 1.5 {areas[ratio > 1.5].sum() / areas.sum():.4f}",
        flush=True,
    )


if __name__ == "__main__":
    main()
