"""Branch `dual` (paper 2): two robots on one part, and the calibrations they need."""
