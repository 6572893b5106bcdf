"""The cell: robot, compliant head, wrist sensor, part and the control loop, simulated by MuJoCo.

MuJoCo is known here, to the branches that simulate and to pages and pictures of the cell; control, motion,
planning, geometry, scoring and analysis do not import it, which import-linter checks (pyproject.toml).
"""

from typing import TYPE_CHECKING

from polish_sim.lazy import names_on_use

if TYPE_CHECKING:
    from polish_sim.cell.cell import Cell, CellRun
    from polish_sim.cell.contact import RealPart, build_pad, press_pad
    from polish_sim.cell.course import build_course
    from polish_sim.cell.faults import FAULTS
    from polish_sim.cell.observer import SILENT, Observer, Silent
    from polish_sim.cell.real_part import Touch, build_real_part, no_part
    from polish_sim.cell.scene import build_scene, tool_on_flange
    from polish_sim.cell.stroke import Stroke
    from polish_sim.cell.wrist_sensor import weight_of
else:
    __getattr__ = names_on_use(__name__)
