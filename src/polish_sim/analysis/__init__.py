"""From a run's record to figures, plots and report; works on saved runs and never imports the cell."""
