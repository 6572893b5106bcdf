"""Moves in the air: approach, lead-in, lead-out, retract, travel."""
