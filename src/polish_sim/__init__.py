"""polish-sim: a MuJoCo testbed for force-controlled robotic polishing."""

__version__ = "0.1.0"
