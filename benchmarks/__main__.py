"""`make bench`: measure and print the table."""

from __future__ import annotations

from benchmarks import control_loop, environments, identification, planning, smoothing_peers, start_up
from benchmarks.table import print_rows


def main() -> None:
    """Print every benchmark's rows as they come."""
    print_rows("One 1 ms step of the closed loop, pad touching, log on", control_loop.measure())
    print_rows("From a large STL to the path on disk", planning.measure())
    print_rows("Smooth motion beside ruckig and toppra", smoothing_peers.measure())
    print_rows("Identification, pinocchio beside it", identification.speed_rows())
    print_rows("Environments of Gymnasium", environments.measure())
    print_rows("Starting", start_up.measure())


main()
