"""The scorecard: a fixed battery of cases, run over the cores, told as tables and one figure (layer 10)."""
