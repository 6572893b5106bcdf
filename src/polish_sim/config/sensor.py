"""Section [sensor] of the scenario (layer 1)."""

from __future__ import annotations

from dataclasses import dataclass

from polish_sim.config.key import key


@dataclass(frozen=True)
class SensorConfig:
    """The six-axis wrist sensor and what the host does with its reading."""

    force_noise_n: float = key(0.5, "white noise per sample, rms [N]", 0.0, 20.0)
    torque_noise_nm: float = key(0.02, "white noise per sample, rms [N m]", 0.0, 2.0)
    force_bias_n: float = key(3.0, "size of the seeded constant bias per axis [N]", 0.0, 100.0)
    torque_bias_nm: float = key(0.1, "size of the seeded constant bias per axis [N m]", 0.0, 10.0)
    force_drift_n_s: float = key(0.002, "drift per axis, rms after one second of its random walk [N/sqrt(s)]", 0.0, 1.0)
    torque_drift_nm_s: float = key(0.0001, "drift per axis [N m/sqrt(s)]", 0.0, 0.1)
    bandwidth_hz: float = key(80.0, "corner of the first-order low-pass, 0 = none [Hz]", 0.0, 490.0)
    rate_hz: float = key(1000.0, "sampling rate [Hz]", 10.0, 10000.0)
    latency_s: float = key(0.002, "from sample to reading [s]", 0.0, 0.1)
    force_quantum_n: float = key(0.02, "smallest step of the reading, 0 = none [N]", 0.0, 5.0)
    torque_quantum_nm: float = key(0.0005, "smallest step of the reading, 0 = none [N m]", 0.0, 0.5)
    force_range_n: float = key(200.0, "the reading saturates here, per axis [N]", 1.0, 1e5)
    torque_range_nm: float = key(8.0, "the reading saturates here, per axis [N m]", 0.1, 1e4)
    payload_mass_error: float = key(
        0.0, "relative error of the compensated tool mass, on top of the calibration's [-]", -1.0, 5.0
    )
