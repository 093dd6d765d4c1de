"""What the robot does, and what its operator wants of it."""

from enum import StrEnum

NS = 1_000_000_000


class Mode(StrEnum):
    DAMPING = "damping"
    STANDING_UP = "standing_up"
    STANDING = "standing"
    WALKING = "walking"
    SITTING_DOWN = "sitting_down"


class Request(StrEnum):
    """What the operator wants."""

    STAND = "stand"
    WALK = "walk"
    SIT = "sit"
    DAMP = "damp"
    """At once and for good"""
