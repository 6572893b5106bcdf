"""Smooth curves through way points and the fastest law of time along them."""
