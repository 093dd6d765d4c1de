"""MuJoCo in the robot's place, on the same datagrams."""
