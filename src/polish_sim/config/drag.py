"""Section [drag] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class DragConfig:
    """A hand that drags the tool along a part in `run teach --follow`, and what is made of its recording."""

    follow: str = key(
        "", "rim: the border of the part's region, a pad's radius inside it; or a path's file; empty = paper 3's moves"
    )
    speed_m_s: float = key(0.05, "how fast the hand goes along it [m/s]", 0.001, 0.5)
    wander_m: float = key(0.0005, "slow wander of the hand, per axis, rms [m]", 0.0, 0.01)
    wander_hz: float = key(0.5, "below this frequency [Hz]", 0.01, 5.0)
    tremor_m: float = key(0.0001, "tremor of the hand from 8 to 12 Hz, per axis, rms [m]", 0.0, 0.005)
    wobble_rad: float = key(0.03, "slow wobble of the tool in the hand, per axis, rms [rad]", 0.0, 0.3)
    turn_stiffness_nm_rad: float = key(30.0, "how stiffly the hand holds the tool's orientation [N m/rad]", 0.0, 1000.0)
    turn_damping_nm_s_rad: float = key(10.0, "and damps its turning [N m s/rad]", 0.0, 100.0)
    filter_hz: float = key(4.0, "the recording is low-passed, both ways, at this frequency [Hz]", 0.1, 100.0)
    tolerance_m: float = key(0.0003, "it is simplified to straight lines within this distance: knots [m]", 1e-6, 0.05)
    spacing_m: float = key(0.002, "distance of the taught path's points [m]", 0.0002, 0.05)
