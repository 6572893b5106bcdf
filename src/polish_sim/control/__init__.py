"""Control laws on plain arrays, without MuJoCo: position, orientation, force, and their hybrid."""

from typing import TYPE_CHECKING

from polish_sim.lazy import names_on_use

if TYPE_CHECKING:
    from polish_sim.control.laws import CONTROLLERS, build_controller
    from polish_sim.control.signals import Controller, Course, Measurement, Target
else:
    __getattr__ = names_on_use(__name__)
