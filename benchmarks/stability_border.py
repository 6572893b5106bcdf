"""`python -m benchmarks.stability_border FILE.png [CONTROLLER ...]`: where the force loop breaks, model and
cell."""

from __future__ import annotations

import sys
from pathlib import Path

from polish_sim.experiments import default_scenario
from polish_sim.scoring.border import measure_border, plot_border

CONTROLLERS = ("hybrid-pi", "force-mode", "hybrid-adaptive")


def main() -> None:
    border = measure_border(default_scenario("force"), sys.argv[2:] or CONTROLLERS)
    plot_border(border).savefig(Path(sys.argv[1]))
    for name, rows in border.rests.items():
        rests = [rest for row in rows for rest in row]
        print(f"  {name:20s}{sum(r.stable for r in rests):4d} of {len(rests)} runs stable, of them", end="")
        print(f"{sum(r.resting for r in rests):4d} at rest")


if __name__ == "__main__":
    main()
