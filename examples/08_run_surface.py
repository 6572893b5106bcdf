"""Plan a spiral and polish two seconds of it in the simulated cell. Prints force figures; takes about ten seconds."""

from polish_sim import default_scenario, override, run_experiment

scenario = override(
    default_scenario("surface"),
    ["part.file=sphere_100", "process.contact_force_n=15", "process.max_feed_s=2", "plan.stepover_m=0.008"],
)
result = run_experiment(scenario)

print("columns of the log:", ", ".join(result.log.names[:6]), "...")
force = result.log["normal_force_n"]
print(f"contact force: {force[result.log['phase'] == 2].mean():.2f} N on average, 15 N asked for")
for name in ("force_rms_error_n", "force_max_deviation_n", "speed_mean_m_s"):
    print(f"{name:22s} {result.figures[name]:.4g}")
