"""The rules that schedule a chain within its limits."""
