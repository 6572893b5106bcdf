"""A region made ready to be planned on: holes bridged, finely triangulated."""
