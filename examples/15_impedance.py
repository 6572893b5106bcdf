"""Impedance control
=================

Position control to the planned depth that yields like a spring, as a controller of your own: the offset x
from the plan follows M d2x/dt2 + D dx/dt + K x = Fd - Fe. Presses with 20 N on a plate that lies 1 mm off its
planned place, and prints the error that stays: with springs k of head and pad in series it is K / (K + k) of
what position control has.
"""

from typing import ClassVar

import numpy as np

from polish_sim import default_scenario, override, run_experiment


class Impedance:
    """Follow the path across the tool axis; along it, follow the plan with an offset that yields to the
    force."""

    ranges: ClassVar = {"mass": (0.1, 100.0), "damping": (1.0, 1e5), "stiffness": (0.0, 1e5)}

    def __init__(self, mass=4.0, damping=283.0, stiffness=1000.0):
        self.mass = mass  # [kg] twice what the wrist sensor carries
        self.damping = damping  # [N s/m] 2 sqrt(k M), critical on the drawn springs, k = 5000 N/m
        self.stiffness = stiffness  # [N/m] k / 5

    def reset(self, cycle_s):
        """Begin a run; ``cycle_s`` is the time between two calls of step [s]."""
        self.cycle_s, self.offset = cycle_s, None

    def step(self, measurement, target):
        """Answer with the tool's twist: linear [m/s], angular [rad/s], base frame."""
        linear = target.twist[:3] + (target.position - measurement.position) / 0.1
        z = measurement.rotation[:, 2]  # the tool axis, into the part
        angular = target.twist[3:] + np.cross(z, target.rotation[:, 2]) / 0.1
        if not target.contact:
            self.offset = None
            return np.concatenate([linear, angular])
        planned, short = target.twist[:3] @ z, (target.position - measurement.position) @ z
        if self.offset is None:  # from the tool's own place and speed
            self.offset, self.velocity = -short, measurement.twist[:3] @ z - planned
        missing = target.force - measurement.wrench[2]  # [N]
        # The damper is taken at the end of the step, so that no damping is too much for it.
        pushed = self.mass * self.velocity + (missing - self.stiffness * self.offset) * self.cycle_s
        self.velocity = np.clip(pushed / (self.mass + self.damping * self.cycle_s), -0.05, 0.05)
        self.offset += self.velocity * self.cycle_s
        rate = np.clip(planned + self.velocity + (short + self.offset) / 0.1, -0.05, 0.05)
        return np.concatenate([linear + (rate - linear @ z) * z, angular])


# %%
# It keeps an error for good wherever part or springs are not as drawn; in exchange it stays where it is when
# contact is lost. ``hybrid-pi`` has no such error.
scenario = override(default_scenario("force"), ["process.hold_s=3", "part.displacement_m=0.001"])
for name, controller in (("position", None), ("impedance", Impedance()), ("hybrid-pi", None)):
    named = override(scenario, [] if controller else [f"controller.name={name}"])
    log = run_experiment(named, controller=controller).log
    held = log["normal_force_n"][log["time_s"] > log["time_s"][-1] - 1.0]
    print(f"{name:10s} {held.mean() - 20.0:+.2f} N off at the end")
