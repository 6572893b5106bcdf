"""What an identification depends on, as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from polish_sim.errors import InputError, unknown_name
from polish_sim.identification.excitation import OBJECTIVES
from polish_sim.identification.regressor import FULL

METHODS: Final = {
    "joint": "all samples in one weighted fit",
    "stepwise": "poses at rest first, then motion, the first step's covariance carried into the second",
    "stepwise-axes": "axes 1 to 3 with the wrist held first, then all axes, the covariance carried likewise",
}
"""How parameters are found, by name."""
LARGEST_PAYLOAD: Final = 3.0
"""The UR5e's five kilograms less the tool's two [kg]."""


@dataclass(frozen=True)
class IdentifySettings:
    """Settings of one simulated identification."""

    method: str = "joint"
    objective: str = "i-optimal"
    periods: int = 5
    """Of 10 s each."""
    rate: float = 1000.0
    """Of the log [Hz]."""
    sigma: tuple[float, ...] = (1.0, 1.0, 1.0, 0.2, 0.2, 0.2)
    """White noise of the torques [N m], joint by joint."""
    encoder: float = 4.8e-5
    """Step of the encoders [rad]: 17 bits a turn."""
    terms: tuple[str, ...] = FULL
    iterations: int = 300
    """Of the search for an exciting motion."""
    starts: int = 1
    """Random motions that search begins from."""
    poses: int = 24
    """At rest, for the stepwise method."""
    payload: float = 0.0
    """Mass of a payload that is found in a second run [kg]; none if 0."""
    seed: int = 0

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise unknown_name("method", self.method, METHODS)
        if self.objective not in OBJECTIVES:
            raise unknown_name("objective", self.objective, OBJECTIVES)
        if not 0.0 <= self.payload <= LARGEST_PAYLOAD:
            raise InputError(
                f"--payload {self.payload:g}: wanted 0 to {LARGEST_PAYLOAD:g} kg, what the arm carries beside its tool."
            )
        if self.periods < 1:
            raise InputError(f"--periods {self.periods}: at least one whole period must be logged.")
