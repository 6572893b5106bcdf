"""Admittance control
==================

The law of most cobots' force modes as a controller of your own: along the tool axis a virtual mass and damper
are pushed by the force error, M dv/dt + D v = Fd - Fe. Runs a step to 20 N with it on springs as drawn and
five times as stiff; prints settling time and overshoot beside those of ``hybrid-pi``.
"""

from typing import ClassVar

import numpy as np

from polish_sim import default_scenario, override, run_experiment


class Admittance:
    """Follow the path across the tool axis; along it, be pushed by the missing force like a mass with a
    damper."""

    ranges: ClassVar = {"mass": (0.1, 100.0), "damping": (1.0, 1e5)}

    def __init__(self, mass=4.0, damping=283.0):
        # [kg] twice what the wrist sensor carries: its inertia then has a loop gain of at most 1/2
        self.mass = mass
        self.damping = damping  # [N s/m] 2 sqrt(k M), critical on the drawn springs, k = 5000 N/m

    def reset(self, cycle_s):
        """Begin a run; ``cycle_s`` is the time between two calls of step [s]."""
        self.cycle_s, self.velocity = cycle_s, None

    def step(self, measurement, target):
        """Answer with the tool's twist: linear [m/s], angular [rad/s], base frame."""
        linear = target.twist[:3] + (target.position - measurement.position) / 0.1
        z = measurement.rotation[:, 2]  # the tool axis, into the part
        angular = target.twist[3:] + np.cross(z, target.rotation[:, 2]) / 0.1
        if not target.contact:
            self.velocity = None
            return np.concatenate([linear, angular])
        if self.velocity is None:  # the mass starts with the tool's own speed
            self.velocity = measurement.twist[:3] @ z
        missing = target.force - measurement.wrench[2]  # [N]
        # The damper is taken at the end of the step, so that no damping is too much for it.
        pushed = self.mass * self.velocity + missing * self.cycle_s
        self.velocity = np.clip(pushed / (self.mass + self.damping * self.cycle_s), -0.05, 0.05)
        return np.concatenate([linear + (self.velocity - linear @ z) * z, angular])


# %%
# Its gain is fixed: right for the springs it was made for, far too much for stiffer ones.
for scale in (1, 5):
    scenario = override(default_scenario("force"), ["process.hold_s=1.5", f"head.spring_scale={scale}"])
    for label, controller in (("Admittance", Admittance()), ("hybrid-pi", None)):
        figures = run_experiment(scenario, controller=controller).figures
        settling, overshoot = figures["settling_time_3n_s"], figures["overshoot_n"]
        within = "never within 3 N" if np.isnan(settling) else f"within 3 N after {settling:.2f} s"
        print(f"springs x {scale}: {label:10s} {within}, overshoot {overshoot:.1f} N")
