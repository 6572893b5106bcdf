"""What the cell must know about itself, estimated from its own readings: payload (layer 8b)."""
