"""Paths for CAM systems and postprocessors: APT/CLDATA text (plan -> GOTO points)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from polish_sim.exchange.apt_reader import NOTE
from polish_sim.exchange.needed_rows import rows_without_straight_air
from polish_sim.exchange.setup import ExportSetup, feeds_of
from polish_sim.planning import PlanResult
from polish_sim.planning.toolpath import APPROACH, RETRACT, SEGMENTS, ToolPath

Array = NDArray[np.float64]

MM = 1e3
PER_MINUTE = 60.0 * MM
IN_THE_AIR = (APPROACH, RETRACT)


def apt_text(result: PlanResult, setup: ExportSetup) -> str:
    """Write a path as APT: mm, tool axis from the part to the tool, RAPID in the air, FEDRAT in mm per minute.

    Positions are printed to 1e-6 mm, axes to 1e-9. Leads move at the approach speed; straight moves in the
    air are one GOTO. Segment, pass and force stand in
    comments, which other systems skip and our own reader takes up.

    Args:
        result: The plan.
        setup: Feed and approach speed where the path has none of its own.

    Returns:
        The text.
    """
    head = [
        f"PARTNO {result.mesh.name}",
        f"$$ tool path by polish-sim: {result.plan.pattern}, step-over {MM * result.plan.stepover_m:g} mm",
        "$$ points lie on the surface, not pressed in; a force-controlled tool presses",
        "UNITS/MM",
        "MULTAX/ON",
    ]
    path = result.path.rows(rows_without_straight_air(result.path))
    return "\n".join([*head, *_motions(path, setup), "FINI", ""])


def _motions(path: ToolPath, setup: ExportSetup) -> Iterator[str]:
    feed = feeds_of(path, setup)
    noted = said = ""
    for row, (position, axis) in enumerate(zip(MM * path.positions_work, path.axes_work, strict=True)):
        note = _note(path, row)
        if note != noted:
            noted = note
            yield note
        if path.segment[row] in IN_THE_AIR:
            yield "RAPID"
        rate = f"FEDRAT/{PER_MINUTE * feed[row]:.6f},MMPM"
        if rate != said:
            said = rate
            yield rate
        yield "GOTO/" + ",".join([*(f"{value:.6f}" for value in position), *(f"{value:.9f}" for value in axis)])


def _note(path: ToolPath, row: int) -> str:
    force = "" if path.force is None else f" force={path.force[row]:.6f}"
    return f"$$ {NOTE} segment={SEGMENTS[path.segment[row]]} pass={path.pass_index[row]}{force}"
