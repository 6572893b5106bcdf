"""URScript: from the text of a programme to threads that run at 500 Hz."""
