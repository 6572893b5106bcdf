"""What the proof of a plan costs: time beside the same plan without it, in units of one play of the cell.

    python -m benchmarks.proof_cost [PART[:STEPOVER_MM[:FEED_MM_S]]]...

Target: with the proof no more than without it and two plays of the cycle, where nothing had to be mended; and
no more memory. Each part is planned, placed and timed once; proof and play then run in the same process,
kernels compiled. The proof plays two parts at once where there are two processors: both its time and the
processors' are printed, of the rest they are the same.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Iterator, Sequence

from benchmarks.table import Row, print_rows, words
from polish_sim.cell import Silent
from polish_sim.experiments import default_scenario
from polish_sim.experiments.assembly import build_cell
from polish_sim.experiments.proof import prove_with_a_pad_that_fits
from polish_sim.experiments.stroke_motion import _MOTIONS
from polish_sim.experiments.surface import prepare_surface
from polish_sim.planning import plan_part
from polish_sim.scenario_file import override

PARTS = ("saddle:16", "wheel_hub_rim:16", "plate_two_holes:24", "sphere_50:12:40")
"""Paths of less than three metres; the last one is slowed, for the wrists turn fast."""


def measure(parts: Sequence[str] = PARTS) -> Iterator[Row]:
    """Plan, prove and play each part."""
    for number, asked in enumerate(parts):
        name, stepover, feed = [*asked.split(":"), *("16", "20")[asked.count(":") :]]
        settings = [f"part.file={name}", f"plan.stepover_m={1e-3 * float(stepover)}",
                    f"process.feed_m_s={1e-3 * float(feed)}"]  # fmt: skip
        scenario = override(default_scenario("surface"), settings)
        if number == 0:
            _once(scenario)  # kernels, and what is loaded at first use
        plan_s, proof_s, busy_s, play_s, figures, memory = _once(scenario)
        path, plays = figures["path_length_m"], figures["proof_work_s"] / figures["cycle_s"]
        yield Row(f"{name}, {path:.2f} m: plan without the proof", f"{plan_s:.2f} s", "-")
        yield Row(f"    proof, {plays:.2f} cycles of work, {figures['mends']} mends", f"{proof_s:.2f} s", "-")
        yield Row("    proof against one play of the cycle", f"{proof_s / play_s:.2f}", "2 + re-plays")
        yield Row("        in processor time", f"{busy_s / play_s:.2f}", "-")
        yield Row("    peak memory with the proof against without", f"{memory:.3f}", "1")


def _once(scenario):  # type: ignore[no-untyped-def]
    """Time of the plan, of its proof, its processor time, that of one play [s], the figures, and how the peak
    memory grew [-]."""
    _MOTIONS.clear()
    begin = time.process_time()
    plan = plan_part(scenario.part, scenario.plan, scenario.process, scenario.pad)
    place = prepare_surface(scenario, plan)
    cell = build_cell(scenario, place)
    planned, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    asked = time.perf_counter()
    proven = prove_with_a_pad_that_fits(scenario, plan)
    proof, busy = time.perf_counter() - asked, time.process_time() - planned
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / before
    place = prepare_surface(proven.scenario, proven.plan)
    cell = build_cell(proven.scenario, place)
    ready = time.process_time()
    run = cell.run(Silent())
    play = time.process_time() - ready
    figures = proven.plan.figures | {"mends": len(proven.plan.mends), "cycle_s": float(run.trace.time_s[-1])}
    return planned - begin, proof, busy, play, figures, memory


if __name__ == "__main__":
    print_rows("The proof of a plan", measure(words(__doc__) or PARTS))
