"""Pages for any browser: a cell in motion, plots and figures in one HTML file that needs no network."""
