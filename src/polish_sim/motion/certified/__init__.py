"""The rule ``certified``: motions whose limits and tolerances are proven on intervals, planned in a stream."""
