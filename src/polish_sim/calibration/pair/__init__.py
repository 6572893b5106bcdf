"""Calibration of two robots together: bases, tool and part adjusted to touches that close their chain (layer 8b)."""

from polish_sim.calibration.pair.adjustment import SOURCES, PairAdjustment, adjust_pair
from polish_sim.calibration.pair.measured import ClosingTouches, PairParts

__all__ = ["SOURCES", "ClosingTouches", "PairAdjustment", "PairParts", "adjust_pair"]
