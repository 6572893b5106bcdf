"""The rules that schedule a chain within its limits, side by side (layer 6)."""
