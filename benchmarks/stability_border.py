"""`python -m benchmarks.stability_border FILE.png [CONTROLLER ...]`: where the force loop breaks, model and
cell."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.table import words
from polish_sim.row_file import Rows
from polish_sim.scoring.border import measure_border, plot_border
from polish_sim.scoring.score import user_entry
from polish_sim.workers import Runner, open_workers

CONTROLLERS = ("hybrid-pi", "force-mode", "hybrid-adaptive")


def main() -> None:
    file, *names = words(__doc__)
    entries = [user_entry(name) for name in names or CONTROLLERS]
    with TemporaryDirectory() as folder, open_workers() as workers:
        border = measure_border(entries, Runner(Rows(Path(folder)), workers))
    plot_border(border).savefig(Path(file))
    for name, rows in border.rests.items():
        rests = [rest for row in rows for rest in row]
        print(f"  {name:20s}{sum(r.stable for r in rests):4d} of {len(rests)} runs stable, of them", end="")
        print(f"{sum(r.resting for r in rests):4d} at rest")


if __name__ == "__main__":
    main()
