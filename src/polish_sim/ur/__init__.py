"""A simulated UR controller: the robot, its URScript interpreter and the ports of its wire."""
