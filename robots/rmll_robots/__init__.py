"""What is true of a robot; one folder a robot."""

from rmll_robots.a1.facts import A1
from rmll_robots.robot import Robot

ROBOTS: dict[str, Robot] = {A1.name: A1}

__all__ = ["A1", "ROBOTS", "Robot"]
