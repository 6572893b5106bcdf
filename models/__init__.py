"""Where the shipped models are: the robot's MJCF and the workpieces' STL files."""
