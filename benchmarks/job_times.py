"""Cycle times of ten different jobs, planned against simulated: parts, tools, patterns and setups.

python -m benchmarks.job_times [--proof nominal]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

from polish_sim.cell import Silent
from polish_sim.job.job_file import read_job
from polish_sim.job.run_job import job_figures, run_job

JOBS = {
    "plate, raster": 'part = "plate"\n{cell}[[setup]]\n[[setup.pass]]\nplan.pattern = "raster"\n'
    "plan.stepover_m = 0.02\nprocess.feed_m_s = 0.03\n",
    "freeform, spiral": 'part = "freeform"\n{cell}[[setup]]\n[[setup.pass]]\nplan.stepover_m = 0.02\n'
    "process.feed_m_s = 0.02\n",
    "saddle, contour": 'part = "saddle"\n{cell}[[setup]]\n[[setup.pass]]\nplan.pattern = "contour"\n'
    "plan.stepover_m = 0.02\nprocess.feed_m_s = 0.02\n",
    "ball, fermat": 'part = "sphere_100"\n{cell}[[setup]]\n[[setup.pass]]\nplan.pattern = "fermat"\n'
    "plan.stepover_m = 0.016\nprocess.feed_m_s = 0.02\n",
    "cylinder, crossed": 'part = "cylinder"\n{cell}[[setup]]\n[[setup.pass]]\nplan.pattern = "raster"\n'
    "plan.raster_direction = [1.0, 0.0, 0.0]\nplan.stepover_m = 0.02\nprocess.feed_m_s = 0.04\n"
    '[[setup.pass]]\nplan.pattern = "raster"\nplan.raster_direction = [0.0, 1.0, 0.0]\n'
    "plan.stepover_m = 0.02\n"
    "process.feed_m_s = 0.04\n",
    "two holes, sander": 'part = "plate_two_holes"\n{cell}[[setup]]\n[[setup.pass]]\n'
    'tool = "orbital-sander-50"\n'
    "plan.stepover_m = 0.015\nprocess.feed_m_s = 0.05\n",
    "plate, wide sander": 'part = "plate"\n{cell}[[setup]]\n[[setup.pass]]\ntool = "orbital-sander"\n'
    "plan.stepover_m = 0.04\nprocess.contact_force_n = 40.0\nprocess.feed_m_s = 0.04\n",
    "freeform, belt": 'part = "freeform"\n{cell}[[setup]]\nregions = '
    '["box:-50,-50,-100,50,50,100"]\n[[setup.pass]]\ntool = "belt-wheel"\nplan.pattern = '
    '"raster"\nplan.stepover_m = 0.012\nprocess.feed_m_s = 0.03\n',
    "plate, both sides": 'part = "plate"\n{cell}[[setup]]\nup = "z"\nregions = ["box:0,0,-50,60,60,100"]\n'
    '[[setup.pass]]\nplan.stepover_m = 0.02\nprocess.feed_m_s = 0.02\n[[setup]]\nup = "-z"\n[[setup.pass]]\n'
    "plan.stepover_m = 0.02\nprocess.feed_m_s = 0.03\n",
    "saddle, even, zone": 'part = "saddle"\n{cell}[[setup]]\n[[setup.pass]]\nplan.removal = "even"\n'
    "plan.stepover_m = 0.02\nprocess.feed_m_s = 0.03\n[[setup.pass.zone]]\n"
    'region = "box:0,0,-100,60,60,100"\n'
    "force = 0.7\nfeed = 0.8\n",
}


def main() -> None:
    """Print a line for each job."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--proof", default="none")
    asked = parser.parse_args()
    cell = f'[cell]\nrobot.arm = "ur5e"\nsafety.proof = "{asked.proof}"\n'
    for name, text in JOBS.items():
        with TemporaryDirectory() as made:
            file = Path(made) / "job.toml"
            file.write_text(text.format(cell=cell))
            job = read_job(file)
            rows = list(run_job(job, Path(made) / "out", Silent()))
            f = job_figures(job, Path(made) / "out", rows)
        done = min(row.figures["path_done"] for row in rows)
        planned, took = f["planned_cycle_time_s"], f["cycle_time_s"]
        print(
            f"{name:20} {len(rows)} passes  planned {planned:6.1f} s  simulated {took:6.1f} s  "
            f"{100 * (planned / took - 1.0):+5.2f}%  path done {100 * done:.0f}%  operator "
            f"{f['operator_s']:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
