"""What a second and a third pass learn from the one before: the force error of runs of `run surface --learn`.

    python -m benchmarks.learning [--seeds 20] [--first 9000] [--feed MM_S]... [--part PART]

Each pass has the part and the arm of its seed, and sensor noise of its own.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.table import Row, print_rows
from polish_sim.analysis.run_record import RunRecord, write_record
from polish_sim.experiments import default_scenario, run_experiment
from polish_sim.scenario_file import override

PASSES = 3


def passes(part: str, feed: float, seed: int) -> list[tuple[float, float]]:
    """Rms and largest error of the force of each pass [N]."""
    found, before = [], ""
    with tempfile.TemporaryDirectory() as folder:
        for number in range(PASSES):
            settings = [f"part.file={part}", f"process.feed_m_s={1e-3 * feed}", f"seed={seed}"]
            result = run_experiment(
                override(default_scenario("surface"), [*settings, f"process.learn={before}"])
            )
            assert result.stop_reason is None, result.stop_reason
            before = str(Path(folder, str(number)))
            Path(before).mkdir()
            record = RunRecord("", result.scenario, result.figures, result.log, result.path, None)
            write_record(Path(before), record)
            found.append((result.figures["force_rms_error_n"], result.figures["force_max_deviation_n"]))
    return found


def measure(part: str, feeds: Sequence[float], seeds: Sequence[int]) -> Iterator[Row]:
    """Worst and median of the seeds, pass by pass."""
    for feed in feeds:
        all_of_them = np.array([passes(part, feed, seed) for seed in seeds])
        for what, column in (("rms", 0), ("largest", 1)):
            for number in range(PASSES):
                values = all_of_them[:, number, column]
                text = f"{np.median(values):.3g} ({values.min():.3g} to {values.max():.3g})"
                yield Row(f"{part}, {feed:g} mm/s, pass {number + 1}: force error, {what} [N]", text, "-")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=9000)
    parser.add_argument("--feed", type=float, action="append", default=[])
    parser.add_argument("--part", default="freeform")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.seeds)
    print_rows("Passes that learn", measure(asked.part, asked.feed or [10.0, 30.0], seeds))
