"""Branch `hand_guiding` (paper 3): an arm guided by hand, and paths taught with it."""
