"""How the tool comes to the part, leaves it and travels between runs."""
