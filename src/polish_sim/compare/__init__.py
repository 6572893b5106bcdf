"""A robot's log beside the simulation: its motion replayed in the cell, measured curves beside simulated
ones."""
