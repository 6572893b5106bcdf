"""How good a path is, ours or not: coverage, exposure, spacing, crossings, sharpness."""
