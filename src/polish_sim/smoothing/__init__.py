"""Branch `smoothing` (paper 4): one path smoothed and played by every rule, and its figures."""
