"""Export for robots, CAM and browsers
===================================

A plan as files for CAM, robots, ROS and browsers, with a force of its own at each waypoint. Prints the files
it writes into results/examples/07_export/; open path.html in a browser.
"""

from dataclasses import replace

import numpy as np

from polish_sim import ExportSetup, PartConfig, PlanConfig, RobotTool, export_plan, plan_part, read_path

result = plan_part(PartConfig("sphere_100"), PlanConfig(stepover_m=0.008))

# Press less where the part is steeper: 20 N on top, 14 N at the border.
steepness = np.arccos(np.clip(result.path.axes_work @ result.mesh.up, -1.0, 1.0))
force = 20.0 - 6.0 * steepness / steepness.max()
feed = np.full(len(force), 0.01)  # [m/s]
result = replace(result, path=replace(result.path, force=force, feed=feed))

setup = ExportSetup(
    part_pose=(0.4, 0.0, 0.1, 0.0, 0.0, 0.0), tool=RobotTool(payload_kg=2.0, spindle_output=1)
)
for file in export_plan("results/examples/07_export", result, ["all"], setup):
    print(f"{file.stat().st_size / 1e3:8.1f} kB  {file}")

back = read_path("results/examples/07_export/path.apt")
pressed, planned = back.positions_work[back.process], result.path.positions_work[result.path.process]
print(f"APT read back: {np.abs(pressed - planned).max():.1e} m off at most")
