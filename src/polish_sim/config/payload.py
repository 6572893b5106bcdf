"""Section [payload] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class PayloadConfig:
    """How the host learns mass and centre of the tool whose weight it compensates."""

    file: str = key(
        "",
        "calibration.toml of `calibrate payload`; empty = the tool is calibrated before the run from this sensor's "
        "readings at rest in the standard poses, the arm's way between them not simulated",
    )
    poses: int = key(12, "poses of the calibration", 4, 500)
    settle_s: float = key(0.5, "the arm stands still this long before it reads [s]", 0.05, 60.0)
    average_s: float = key(0.5, "readings are averaged over this time in each pose [s]", 0.005, 600.0)
