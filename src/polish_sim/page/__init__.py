"""Pages for any browser: a cell in motion, plots and figures in one HTML file that needs no network."""

PAGE = "report.html"  #: Its name in a folder of results
