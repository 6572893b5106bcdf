"""Your own controller
===================

A controller is a class with two methods; it needs only numpy. Here the tool yields like a damper: it moves
into the part at a speed proportional to the force that is missing. Runs a step to 20 N with it and with
``hybrid-pi``; prints settling time and overshoot.
"""

import matplotlib.pyplot as plt
import numpy as np

from polish_sim import default_scenario, override, run_experiment


class Damper:
    """Follow the path across the tool axis; along it, move at a speed proportional to the missing force."""

    def reset(self, cycle_s):
        """Begin a run; ``cycle_s`` is the time between two calls of step [s]."""

    def step(self, measurement, target):
        """Answer with the tool's twist: linear [m/s], angular [rad/s], base frame."""
        linear = target.twist[:3] + (target.position - measurement.position) / 0.1
        z = measurement.rotation[:, 2]  # the tool axis, into the part
        if target.contact:
            missing = target.force - measurement.wrench[2]  # [N]
            linear += (np.clip(0.002 * missing, -0.02, 0.02) - linear @ z) * z
        angular = target.twist[3:] + np.cross(z, target.rotation[:, 2]) / 0.1
        return np.concatenate([linear, angular])


# %%
# On the command line the same class is named by its file, ``--controller mine.py:Damper``.
figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
scenario = override(default_scenario("force"), ["process.hold_s=1.5"])
for label, controller in (("Damper", Damper()), ("hybrid-pi", None)):
    result = run_experiment(scenario, controller=controller)
    settling, overshoot = result.figures["settling_time_3n_s"], result.figures["overshoot_n"]
    print(f"{label:10s} within 3 N after {settling:.2f} s, overshoot {overshoot:.2f} N")
    axes.plot(result.log["time_s"], result.log["normal_force_n"], label=label)
axes.set(xlabel="time [s]", ylabel="normal force [N]")
axes.legend(loc="lower right")
plt.show()
