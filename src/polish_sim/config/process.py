"""Section [process] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class ProcessConfig:
    """What the tool is asked to do on the part."""

    contact_force_n: float = key(20.0, "force to hold along the tool axis [N]", 0.5, 200.0)
    feed_m_s: float = key(0.01, "speed along the path [m/s]", 1e-4, 0.5)
    approach_speed_m_s: float = key(0.005, "speed of the approach [m/s]", 1e-4, 0.1)
    hold_s: float = key(4.0, "how long `force` holds after first contact [s]", 1.0, 600.0)
    contact_threshold_n: float = key(
        2.0, "measured force that counts as contact; if the sensor is noisier, 5 sigma of its noise do [N]", 0.1, 50.0
    )
    tare: str = key("start", "when the sensor is zeroed in free space: start (of the run) or strokes (before each one)")
    search_depth_m: float = key(0.01, "how far past the nominal surface contact is sought [m]", 0.0, 0.1)
    preston_1_pa: float = key(
        0.0, "wear coefficient of Preston's law, removal = this x pressure x way; 0 = unknown, removal relative [1/Pa]",
        0.0, 1.0,
    )  # fmt: skip
    max_feed_s: float = key(0.0, "stop the feed after this long, 0 = the whole path [s]", 0.0, 1e6)
