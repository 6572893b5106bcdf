"""Parts by the hundred as users have them: drawn by a seed, planned with the proof, run as another seed draws
them.

Each draw takes a family, its size and shape, a pad of 10 to 50 mm, an overlap, a feed of 10 to 40 mm/s and a
controller; nothing was tuned on them. Rows go to a CSV as they are done; the same command resumes with what
is missing.

    python -m benchmarks.field_parts [--count 100] [--seed 1] [--family NAME]... [--csv FILE] [--keep FOLDER]
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import json
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.field_families import FAMILIES, draw_mesh
from polish_sim.cli.boundary import DONE, execute
from polish_sim.cli.main import commands

PADS_MM, OVERLAPS, FEEDS_MM_S = (10, 12, 16, 20, 25, 32, 40, 50), (30, 50, 60), (10, 15, 20, 30, 40)
CONTROLLERS: Final = ("hybrid-pi", "hybrid-adaptive")
LONGEST_M: Final = 3.0  #: The pad is drawn no smaller than gives about such a path
FIRST_RUN_SEED: Final = 500
COLUMNS: Final = (
    *(
        "number",
        "family",
        "size_mm",
        "pad_mm",
        "overlap",
        "feed_mm_s",
        "controller",
        "outcome",
        "reason",
        "plan_s",
        "run_s",
    ),
    *("path_m", "polished", "mends", "force_max_n", "error_max_n", "contact_lost_s"),
)


def _call(words: Sequence[str]) -> tuple[int, float, str]:
    """Run a command in this process: its exit code, time [s] and what it said of errors."""
    out, err, begin = io.StringIO(), io.StringIO(), time.perf_counter()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = execute(commands, list(words))
    said = [line for line in err.getvalue().splitlines() if line.startswith(("error", "bad"))]
    return code, time.perf_counter() - begin, " ".join(said)


def _figures(folder: Path) -> dict[str, Any]:
    file = folder / "metrics.json"
    return dict(json.loads(file.read_text())) if file.is_file() else {}


def play(number: int, names: Sequence[str], seed: int, folder: Path) -> dict[str, Any]:
    """Draw a part and settings, plan and run it; the row."""
    rng, family = np.random.default_rng([seed, number]), names[number % len(names)]
    mesh = draw_mesh(FAMILIES[family], rng)
    size = float(np.ptp(mesh.vertices, axis=0).max())
    pad, overlap, feed = (int(rng.choice(choices)) for choices in (PADS_MM, OVERLAPS, FEEDS_MM_S))
    controller = str(rng.choice(CONTROLLERS))
    while pad * (1.0 - 0.01 * overlap) < 0.4e-3 * size * size / LONGEST_M and pad < PADS_MM[-1]:
        pad += 5
    mesh.export(folder / f"{family}.stl")
    row: dict[str, Any] = {
        "number": number, "family": family, "size_mm": round(size), "pad_mm": pad, "overlap": overlap,
        "feed_mm_s": feed, "controller": controller,
    }  # fmt: skip
    asked = [
        "--pad-diameter",
        str(pad),
        "--overlap",
        str(overlap),
        "--feed",
        str(feed),
        "--controller",
        controller,
    ]
    plan, run = folder / "plan", folder / "run"
    words = ["plan", str(folder / f"{family}.stl"), *FAMILIES[family].options, *asked, "--out", str(plan)]
    code, row["plan_s"], said = _call(words)
    if code != DONE:
        return row | {"outcome": "refused" if code == 2 else f"plan exit {code}", "reason": said}
    planned, proof = _figures(plan), json.loads((plan / "path.json").read_text())["proof"]
    row |= {"path_m": planned["path_length_m"], "mends": len(proof["mends"]),
            "polished": planned["polished_area_m2"] / planned["region_area_m2"]}  # fmt: skip
    drawn = ["--seed", str(FIRST_RUN_SEED + number), "--controller", controller, "--out", str(run)]
    code, row["run_s"], said = _call(["run", "surface", "--path", str(plan), *drawn])
    done = _figures(run)
    row |= {"force_max_n": done.get("peak_force_n"), "error_max_n": done.get("force_max_deviation_n"),
            "contact_lost_s": done.get("contact_lost_s")}  # fmt: skip
    bad = [text for text in done.get("bad_figures", []) if "left out" not in text]
    outcome = (
        "stopped" if code == 3 else f"run exit {code}" if code else "bad figures, said" if bad else "polished"
    )
    return row | {"outcome": outcome, "reason": said if code else "; ".join(bad)}


def main() -> None:
    """Play the draws and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--family", action="append", choices=list(FAMILIES), default=[])
    parser.add_argument("--csv", type=Path, default=Path("field_parts.csv"))
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    rows = list(csv.DictReader(asked.csv.open())) if asked.csv.is_file() else []
    done = {int(row["number"]) for row in rows}
    names = asked.family or list(FAMILIES)
    with asked.csv.open("a", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS)
        if not rows:
            writer.writeheader()
        for number in (k for k in range(asked.count) if k not in done):
            folder = Path(tempfile.mkdtemp()) if asked.keep is None else asked.keep / f"{number:04d}"
            folder.mkdir(parents=True, exist_ok=True)
            row = play(number, names, asked.seed, folder)
            if asked.keep is None:
                shutil.rmtree(folder)
            writer.writerow(row)
            stream.flush()
            rows.append({name: str(value) for name, value in row.items()})
            print({name: round(v, 3) if isinstance(v, float) else v for name, v in row.items()}, flush=True)
    counts = Counter(row["outcome"] for row in rows)
    print(*(f"{count:4d}  {outcome}" for outcome, count in counts.most_common()), sep="\n")
    shares = [float(row["polished"]) for row in rows if row.get("polished")]
    print(
        f"polished share of the region: median {np.median(shares):.3f}, worst tenth "
        f"{np.quantile(shares, 0.1):.3f}"
    )


if __name__ == "__main__":
    main()
