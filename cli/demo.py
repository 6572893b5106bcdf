"""`polish-sim demo`: the whole main job on a shipped part, at most 60 s of simulated feed."""

from __future__ import annotations

from typing import Final

from polish_sim.cli import console
from polish_sim.cli.option_types import Out, Overwrite
from polish_sim.cli.output_folder import claimed
from polish_sim.cli.rendering import prepare_headless
from polish_sim.cli.sinks import open_sinks
from polish_sim.scenario_file import merge

# Feed and step-over such that the whole spiral is fed in less than 60 s.
DEMO: Final = {"part": {"file": "freeform"}, "plan": {"stepover_m": 0.02}, "process": {"feed_m_s": 0.03}}


def demo(out: Out = None, overwrite: Overwrite = False) -> int:
    """Plan a path on a shipped part and polish it under force control, with a short report."""
    prepare_headless()
    # Lazy: the simulator takes a second to load, --help must not wait for it.
    from polish_sim.cli.simulation import run_once
    from polish_sim.experiments import default_scenario

    scenario = merge(default_scenario("surface"), DEMO, "")
    console.note(f"demo: polish the shipped part '{scenario.part.file}' at {scenario.process.contact_force_n:g} N")
    with claimed(out, "demo", overwrite) as folder:
        outcome = run_once(scenario, None, folder.draft, open_sinks(folder.draft, view=False, video=False))
    outcome.show()
    console.say("pictures and figures are in the folder; for more: polish-sim run --help")
    console.say(f"folder: {folder.final}")
    return outcome.exit_code(check=False)
