"""Calibrations of tool, bases and arms: arrays in, estimates with covariance out."""
