"""Controller ``force-mode``: a UR robot's own force mode along tool z, as far as that is public; else
``hybrid-pi``."""

from __future__ import annotations

from polish_sim.config import ControllerConfig
from polish_sim.control.hybrid import (
    HybridGains,
    HybridMemory,
    along_z,
    hybrid_gains,
    position_by_velocity,
    replace_along_z,
    turn_and_level,
)
from polish_sim.control.signals import LAW_SIGNATURE, CompiledController, records_at
from polish_sim.kernel_cache import cfunc
from polish_sim.kernels import Record, kernel

STEP_S = 0.002  #: The mode's own cycle [s]


class ForceModeGains(Record):
    """Gains of the loops around the mode and its own."""

    hybrid: HybridGains
    mass: float  #: Virtual mass M / scaling [kg]
    damping: float  #: Share of the speed lost per step [-]
    limit: float  #: Largest speed [m/s]


class ForceModeMemory(Record):
    """All zero after a reset."""

    hybrid: HybridMemory
    velocity: float  #: [m/s]
    started: bool  #: In contact
    passed: float  #: Time since the mode's last step [s]
    sum: float  #: Of the force errors since [N]
    readings: int  #: Since then


class ForceModeContext(Record):
    """What the law reads and writes."""

    gains: ForceModeGains
    memory: ForceModeMemory


_MODE = ForceModeContext.dtype


@kernel
def mode_speed(error: float, dt: float, gains: ForceModeGains, memory: ForceModeMemory) -> float:
    """Speed of the mode [m/s] for the ``error`` Fd - Fe [N], renewed every 2 ms and held in between."""
    memory.passed += dt
    memory.sum += error
    memory.readings += 1
    if memory.passed >= STEP_S - 1e-9:
        gained = memory.sum / memory.readings * memory.passed / gains.mass
        kept = (1.0 - gains.damping) ** (memory.passed / STEP_S)
        memory.velocity = min(max(kept * memory.velocity + gained, -gains.limit), gains.limit)
        memory.passed = memory.sum = 0.0
        memory.readings = 0
    return memory.velocity


@cfunc(LAW_SIGNATURE)
def _force_mode_law(context, _course, measurement, target, answer):  # type: ignore[no-untyped-def]
    """Everything but tool z, and before contact tool z too, as ``hybrid-pi`` does it."""
    c, m, t, out = records_at(context, _MODE, measurement, target, answer)
    gains, memory = c.gains.hybrid, c.memory
    position_by_velocity(m, t, gains.position, memory.hybrid, out.twist)
    turn_and_level(m, t, gains, memory.hybrid, out.twist)
    if not t.contact:
        memory.started = False
        return
    if not memory.started:
        # Bumpless: from the tool's own speed.
        memory.started = True
        memory.velocity = along_z(m, m.twist)
        memory.passed = memory.sum = 0.0
        memory.readings = 0
    replace_along_z(m, mode_speed(t.force - m.wrench[2], m.cycle, c.gains, memory), out.twist)


def force_mode(config: ControllerConfig) -> CompiledController:
    """A robot's own force mode along tool z."""
    own = config.baselines
    mass = own.mode_mass_kg / own.mode_gain_scaling
    gains = ForceModeGains(hybrid_gains(config), mass, own.mode_damping, config.force_limit_m_s)
    return CompiledController(ForceModeContext(gains), _force_mode_law)
