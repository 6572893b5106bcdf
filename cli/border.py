"""`polish-sim score --border`: springs and latencies up to which controllers stay stable; imported only
inside it."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE
from polish_sim.cli.output_folder import put
from polish_sim.row_file import package_versions, plain, save_plots
from polish_sim.scoring.border import Border, plot_border


def show_border(border: Border, folder: Path) -> int:
    """Draw and show the border of stability, in the cell and in the linear model."""
    facts = _facts(border)
    text = json.dumps(plain(facts | {"versions": package_versions()}), indent=1, allow_nan=False)
    put(folder, "border.json", text + "\n")
    save_plots(folder, {"border.png": plot_border(border)})
    for label, found in facts["controllers"].items():
        console.table(
            f"stable up to this latency, {label}", ["springs", "in the cell [ms]", "linear model [ms]"],
            _rows(found, border),
        )  # fmt: skip
    console.say_folder(folder)
    return DONE


def _facts(border: Border) -> dict[str, Any]:
    """What each run did, and the longest latency that is stable by scale of the springs."""
    controllers = {}
    for name, rests in border.rests.items():
        stable = [[rest.stable for rest in row] for row in rests]
        line = np.interp(np.log(border.scales), np.log(border.line_scales), border.lines[name])
        controllers[name] = {
            "stable": stable,
            "at_rest": [[rest.resting for rest in row] for row in rests],
            "swing_n": [[rest.swing for rest in row] for row in rests],
            "latency_stable_s": [_longest(border, column) for column in zip(*stable, strict=True)],
            "latency_stable_model_s": line,
        }
    return {"spring_scales": border.scales, "latencies_s": border.latencies, "controllers": controllers}


def _longest(border: Border, stable: Sequence[bool | None]) -> float | None:
    """The longest latency up to which every run was stable [s]; None if already the shortest was not."""
    known = takewhile(lambda run: run[1] is not False, zip(border.latencies.tolist(), stable, strict=True))
    return max((latency for latency, held in known if held), default=None)


def _rows(found: dict[str, Any], border: Border) -> list[list[str]]:
    rows = []
    for scale, cell, model in zip(
        border.scales, found["latency_stable_s"], found["latency_stable_model_s"], strict=True
    ):
        all_of_it = cell is not None and cell == border.latencies[-1]
        shown = "none" if cell is None else f"{'>= ' if all_of_it else ''}{1e3 * cell:.0f}"
        rows.append([f"{scale:g} x", shown, f"{1e3 * model:.0f}" if math.isfinite(model) else "-"])
    return rows
