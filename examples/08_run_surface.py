"""Paper 1: polish a surface with one robot
=========================================

Plan a spiral over the facets of a mesh, press it into the part, and keep the force constant while the tool is
fed along it. Polishes two seconds of it in the simulated cell and prints force figures; takes about ten
seconds.
"""

import matplotlib.pyplot as plt

from polish_sim import default_scenario, override, run_experiment

# %%
# A scenario holds every setting of a run: part, plan, robot, sensor, controller. The default controller,
# ``hybrid-pi``, is the paper's: position control across the tool axis, a PI law on the force along it.
scenario = override(
    default_scenario("surface"),
    ["part.file=sphere_100", "process.contact_force_n=15", "process.max_feed_s=2", "plan.stepover_m=0.008"],
)
result = run_experiment(scenario)

# %%
# The log has a row every 4 ms. ``normal_force_n`` is the exact force along the tool axis; the controller only
# sees ``wrench_measured_tool``, which is filtered, late and noisy. Phase 2 is the process: the tool is fed at
# the set force.
print("columns of the log:", ", ".join(result.log.names[:6]), "...")
force = result.log["normal_force_n"]
print(f"contact force: {force[result.log.fed].mean():.2f} N on average, 15 N asked for")
for name in ("force_rms_error_n", "force_max_deviation_n", "speed_mean_m_s"):
    print(f"{name:22s} {result.figures[name]:.4g}")

# %%
# Touch-down at 15 N, then the feed begins.
figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
time = result.log["time_s"]
axes.plot(time, result.log["wrench_measured_tool"][:, 2], color="0.7", linewidth=0.8, label="measured")
axes.plot(time, force, label="exact")
axes.axhline(15.0, color="black", linestyle="--", linewidth=1, label="set")
axes.set(xlabel="time [s]", ylabel="normal force [N]")
axes.legend(loc="lower right")
plt.show()
