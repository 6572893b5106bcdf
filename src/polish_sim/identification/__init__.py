"""From a robot's own motion to its dynamics: regressor, base parameters, excitation, estimation."""
