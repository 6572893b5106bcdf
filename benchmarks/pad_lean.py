"""How aslant the pad stands on a part as it lies: the tool's axis against the planned one, turned like it.

    python -m benchmarks.pad_lean [--part PART] [--first 700] [--seeds 8] [--set KEY=VALUE]...

Bends of the part (some 0.2 deg) are left out. Printed are mean and largest lean over the seeds, and
how uneven the removal is, which is what a lean would harm.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.table import Row, print_rows
from polish_sim.experiments import default_scenario
from polish_sim.experiments.assembly import build_cell, check
from polish_sim.experiments.even_removal import planned
from polish_sim.experiments.surface import measure_run, prepare_surface
from polish_sim.log import PROCESS_PHASE
from polish_sim.scenario_file import override


def measure(part: str, seeds: Sequence[int], changes: Sequence[str]) -> Iterator[Row]:
    """Mean and largest lean of the seeds, and their removal."""
    scenario, plan = planned(check(override(default_scenario("surface"), [f"part.file={part}", *changes])))
    leans, spreads, touched = [], [], []
    for seed in seeds:
        drawn = check(override(scenario, [f"seed={seed}"]))
        place = prepare_surface(drawn, plan)
        cell = build_cell(drawn, place)
        run = cell.run()
        assert run.stop_reason is None, run.stop_reason
        fed = run.log["phase"] == PROCESS_PHASE
        tool, target = (
            Rotation.from_quat(run.log[f"{name}_quaternion_wxyz"][fed], scalar_first=True).as_matrix()[
                :, :, 2
            ]
            for name in ("tcp", "target")
        )
        turned = target @ (cell.part.rotation @ place.reach.T_base_work[:3, :3].T).T
        leans.append(np.degrees(np.arccos(np.minimum((tool * turned).sum(axis=1), 1.0))))
        figures = measure_run(plan, place, cell, run).figures
        spreads.append(100.0 * figures["removal_cv"])
        touched.append(100.0 * figures["coverage"])
    means = [lean.mean() for lean in leans]
    yield Row("lean, mean of the seeds; worst seed [deg]", f"{np.mean(means):.2f}; {max(means):.2f}", "-")
    yield Row("lean at most [deg]", f"{max(lean.max() for lean in leans):.2f}", "-")
    yield Row("removal, std / mean; worst seed [%]", f"{np.mean(spreads):.1f}; {max(spreads):.1f}", "-")
    yield Row("region touched, least [%]", f"{min(touched):.1f}", "-")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", default="freeform")
    parser.add_argument("--first", type=int, default=700)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--set", action="append", default=[])
    asked = parser.parse_args()
    changed = ["process.feed_m_s=0.03", *asked.set]
    title = " ".join([f"Lean of the pad on {asked.part} at 30 mm/s", *asked.set])
    print_rows(title, measure(asked.part, range(asked.first, asked.first + asked.seeds), changed))
