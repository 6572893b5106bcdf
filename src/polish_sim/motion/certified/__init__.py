"""The rule ``certified``: corners, connectors and look-ahead, limits proven on intervals (layer 6)."""
