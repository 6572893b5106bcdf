"""A job: setups x regions x passes, planned, simulated and written, part after part."""
