"""Control laws on plain arrays, without MuJoCo: position, orientation, force, and their hybrid (layer 7)."""

from polish_sim.control.course import Course
from polish_sim.control.laws import CONTROLLERS, Controller, gains_of
from polish_sim.control.signals import Measurement, Target
from polish_sim.control.user_controller import build_controller

__all__ = ["CONTROLLERS", "Controller", "Course", "Measurement", "Target", "build_controller", "gains_of"]
