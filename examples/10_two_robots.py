"""Paper 2: two robots
===================

The master moves a wheel hub, the follower's tool goes along the hub's rim meanwhile. Bases, tool and part are
calibrated first, with simulated instruments that have noise. Runs half a second of it, 5 mm above the rim at
50 mm/s; prints the tool's error on the part.
"""

import matplotlib.pyplot as plt
import numpy as np

from polish_sim import default_scenario, override, run_experiment

settings = [
    "dual.standoff_m=0.005",
    "process.feed_m_s=0.05",
    "dual.master_speed_m_s=0.02",
    "process.max_feed_s=0.5",
]

# %%
# The arms are ``ideal`` here: rigid, exactly as their tables say. What is left is calibration and tracking.
result = run_experiment(override(default_scenario("dual"), [*settings, "robot.arm=ideal"]))
figures = result.figures
print(f"tool on the part: {1e3 * figures['relative_error_rms_m']:.3f} mm rms")
print(f"tracking, worst axis: {1e3 * max(figures['tracking_error_max_m']):.3f} mm")
print(f"the part moved by {1e3 * figures['master_way_m']:.1f} mm")

# %%
# The error of the tool on the part, axis by axis, while it is fed.
fed = result.log.fed
figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
lines = axes.plot(result.log["time_s"][fed], 1e3 * np.atleast_2d(result.log["relative_error_m"][fed]))
for line, name in zip(lines, "xyz", strict=True):
    line.set_label(name)
axes.set(xlabel="time [s]", ylabel="tool on the part [mm]")
axes.legend()
plt.show()
