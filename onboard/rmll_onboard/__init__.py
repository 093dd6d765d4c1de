"""The runtime on the robot."""
