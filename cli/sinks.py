"""Who looks on during a run: what --view and --video ask for, and the picture every run gets."""

from __future__ import annotations

from pathlib import Path

from polish_sim.cli.frames import FrameSink
from polish_sim.cli.snapshot import Snapshot
from polish_sim.cli.video import Video
from polish_sim.cli.viewer import Viewer

CELL_PICTURE = "cell.png"


def open_sinks(draft: Path, view: bool, video: bool) -> list[FrameSink]:
    """The sinks of one run; ``draft`` is where pictures and films go."""
    sinks: list[FrameSink] = [Snapshot(draft / CELL_PICTURE)]
    if view:
        sinks.append(Viewer())
    if video:
        sinks.append(Video(draft))
    return sinks
