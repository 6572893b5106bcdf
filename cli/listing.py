"""`polish-sim list`: what ships with the package."""

from __future__ import annotations

from polish_sim.cli import console


def list_names() -> None:
    """List the parts, controllers, experiments and patterns that ship with the package."""
    # Lazy: --help must not wait for the numerical libraries.
    from polish_sim.control import CONTROLLERS
    from polish_sim.experiments import EXPERIMENTS
    from polish_sim.models import workpiece_names
    from polish_sim.planning import PATTERNS

    console.say(f"parts:        {', '.join(workpiece_names())}")
    console.say(f"controllers:  {', '.join(CONTROLLERS)}, FILE.py:CLASS")
    console.say(f"experiments:  {', '.join(EXPERIMENTS)}")
    console.say(f"patterns:     {', '.join(PATTERNS)}")
