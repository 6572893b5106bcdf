"""Speeds as ratios: against a bare engine step, against the limits the project sets itself."""
