"""Paper 4: smooth a path of short segments
=========================================

Round the corners of a tool path inside a tolerance and keep speed, acceleration and jerk in limits. Three
rules on one square of 20 mm; prints cycle time and deviation.
"""

import matplotlib.pyplot as plt
import numpy as np

from polish_sim.motion.rules.chain import chain_from_axes
from polish_sim.motion.rules.deviation import measure_deviation
from polish_sim.motion.rules.limits import SmoothingLimits
from polish_sim.motion.rules.schedule import RULES

TOLERANCE, AXIS_TOLERANCE = 2e-5, np.radians(0.02)  # [m], [rad]
corners = 0.02 * np.array(
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
)
square = chain_from_axes(corners, np.tile([0.0, 0.0, -1.0], (len(corners), 1)))

# %%
# The paper's two rules keep the tolerance at the vertex; ``spline`` is ours and keeps the path's. Without an
# arm (the last two arguments) joints do not count, and the paper's two rules are the same.
figure, (way, speed) = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
way.plot(*1e3 * corners[:, :2].T, color="black", linewidth=0.8, label="path")
for (name, rule), style in zip(RULES.items(), ("-", "-", "--"), strict=True):
    motion = rule(square, SmoothingLimits(), TOLERANCE, AXIS_TOLERANCE, None, None)
    deviation = measure_deviation(motion, square)
    print(f"{name:18s} {motion.end:.3f} s, off the path by {1e6 * deviation.contour.value:.1f} um at most")
    clock = np.linspace(0.0, motion.end, 20000)
    tips = motion.sample(clock).tips
    way.plot(*1e3 * tips[:, 0, :2].T, linestyle=style, label=name)
    speed.plot(clock, 1e3 * np.linalg.norm(tips[:, 1], axis=1), linestyle=style, label=name)
way.set(
    xlabel="x [mm]",
    ylabel="y [mm]",
    xlim=(19.8, 20.05),
    ylim=(-0.05, 0.2),
    title="one corner, from near",
    aspect="equal",
)
speed.set(xlabel="time [s]", ylabel="speed of the tip [mm/s]")
speed.legend(loc="lower center", fontsize="small")
plt.show()
