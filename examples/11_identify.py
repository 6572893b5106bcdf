"""Paper 3: identify the arm, guide it by hand
============================================

Find inertia and friction of the arm from its own motion, then let a hand move it. Prints how well the
identified model predicts the torques of a motion that was not fitted, and the hand's force with and without
compensation; takes about twenty seconds.
"""

import matplotlib.pyplot as plt
import numpy as np

from polish_sim import default_scenario, override, run_experiment
from polish_sim.config import RobotConfig
from polish_sim.identification import IdentifySettings
from polish_sim.identification.identify import run_identification

# %%
# One period (10 s) of an exciting motion, on the arm without elastic gears. The search for the motion is cut
# short: 15 steps, not 300.
found = run_identification(
    IdentifySettings(periods=1, rate=500.0, iterations=15, robot=RobotConfig(arm="ideal"))
)
error, drawing = 100 * found.figures["nrms_heldout_mean"], 100 * found.figures["nrms_heldout_drawing_mean"]
print(f"torque of another motion, error / range: {error:.3f} %, by the drawing {drawing:.2f} %")

# %%
# A hand drags the tool 0.3 m along x in 0.8 s. With gravity and friction compensated it still accelerates the
# arm's inertia; with the inertia compensated too, less of it.
figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
for mode in ("classical", "inertia"):
    settings = [
        f"guide.mode={mode}",
        "guide.direction=x",
        "guide.duration_s=0.8",
        "hand.off_s=0.5",
        "robot.arm=ideal",
    ]
    guided = run_experiment(override(default_scenario("teach"), settings))
    print(f"{mode:10s} the hand's force is {guided.figures['hand_force_peak_n']:.1f} N at most")
    axes.plot(guided.log["time_s"], np.linalg.norm(guided.log["hand_force_n"], axis=1), label=mode)
axes.set(xlabel="time [s]", ylabel="force of the hand [N]")
axes.legend()
plt.show()
