"""The observation of a policy: which numbers, in which order, at which scale.

The layout is data (it travels in the bundle), and :func:`write` fills it with plain slice
assignments, so NumPy on the robot and torch in the trainer run the very same code.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import msgspec

Profile = Literal["paper", "imu"]


class Field(msgspec.Struct, frozen=True):
    """One named stretch of an observation: ``size`` numbers, each multiplied by ``scale``."""

    name: str
    size: int
    scale: float


Layout = tuple[Field, ...]

JOINTS = 12
# Scales: the paper's code (phi and c_f x 0.1) and legged_gym (joint velocity x 0.05, velocity x 2,
# angular velocity x 0.25).
ESTIMATES: Layout = (Field("velocity", 3, 2.0), Field("foot_height", 4, 1.0))


def layout(profile: Profile, num_states: int) -> Layout:
    """Fields in order, without the estimates, which the policy's own graph appends.

    ``rm_state`` is one-hot; ``phi`` and ``command_frequency`` are in policy steps;
    ``joint_position`` [rad] is relative to the default pose; ``joint_velocity`` [rad/s];
    commands [m/s], [rad/s]; ``projected_gravity`` is the unit gravity vector and
    ``angular_velocity`` [rad/s] the gyroscope, both in the base frame.
    """
    fields = (
        Field("rm_state", num_states, 1.0),
        Field("phi", 1, 0.1),
        Field("joint_position", JOINTS, 1.0),
        Field("joint_velocity", JOINTS, 0.05),
        Field("last_action", JOINTS, 1.0),
        Field("command_vx", 1, 1.0),
        Field("command_wz", 1, 1.0),
        Field("command_frequency", 1, 0.1),
    )
    if profile == "imu":
        fields += (Field("projected_gravity", 3, 1.0), Field("angular_velocity", 3, 0.25))
    return fields


def size(fields: Sequence[Field]) -> int:
    """Length of an observation with these fields."""
    return sum(field.size for field in fields)


def find(fields: Sequence[Field], name: str) -> slice:
    """Where in an observation with these fields ``name`` is; KeyError without it."""
    start = 0
    for field in fields:
        if field.name == name:
            return slice(start, start + field.size)
        start += field.size
    raise KeyError(name)


def write(out: Any, fields: Sequence[Field], parts: Mapping[str, Any]) -> Any:
    """Fill ``out`` (..., size) with the scaled ``parts``, each (..., field.size); returns it."""
    start = 0
    for field in fields:
        stop = start + field.size
        part = parts[field.name]
        out[..., start:stop] = part if field.scale == 1 else part * field.scale
        start = stop
    return out
