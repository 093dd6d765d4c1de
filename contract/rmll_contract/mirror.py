"""Left and right swapped: how every number of an observation or an action looks in a mirror.

The mirror is the plane of the base's x and z axes. Legs change places; so do the automaton's
states, by :func:`rmll_gaits.symmetry.mirror_states`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rmll_common.errors import InputError
from rmll_contract.observation import Field
from rmll_gaits.symmetry import MIRROR_FEET
from rmll_robots import Robot


class Mirror(NamedTuple):
    """The mirror image of a vector (..., n) is ``vector[..., source] * sign``."""

    source: NDArray[np.int64]
    sign: NDArray[np.float32]


def _mirror(source: Sequence[int], sign: Sequence[int]) -> Mirror:
    return Mirror(np.array(source), np.array(sign, np.float32))


_SAME = _mirror([0], [1])
_OPPOSITE = _mirror([0], [-1])
_FEET = _mirror(MIRROR_FEET, [1] * 4)
# A hip turns about x and changes sign; thigh and calf turn about y and do not.
_JOINTS = _mirror([3 * foot + joint for foot in MIRROR_FEET for joint in range(3)], [-1, 1, 1] * 4)
_VECTOR = _mirror([0, 1, 2], [1, -1, 1])
_ROTATION = _mirror([0, 1, 2], [-1, 1, -1])

_FIELDS = {
    "phi": _SAME,
    "joint_position": _JOINTS,
    "joint_velocity": _JOINTS,
    "last_action": _JOINTS,
    "command_vx": _SAME,
    "command_wz": _OPPOSITE,
    "command_frequency": _SAME,
    "projected_gravity": _VECTOR,
    "angular_velocity": _ROTATION,
    "velocity": _VECTOR,
    "foot_height": _FEET,
    "foot_down": _FEET,
    "base_height": _SAME,
}


def mirror_layout(fields: Sequence[Field], states: Sequence[int]) -> Mirror:
    """The mirror of an observation with these fields; ``states`` is each state's mirror image."""
    # states is its own inverse, so it is also where the mirrored one-hot reads from
    parts = _FIELDS | {"rm_state": _mirror(states, [1] * len(states))}
    source, sign, start = [], [], 0
    for field in fields:
        part = parts[field.name]
        source.append(start + part.source)
        sign.append(part.sign)
        start += field.size
    return Mirror(np.concatenate(source), np.concatenate(sign))


def mirror_action(robot: Robot) -> Mirror:
    """The mirror of an action, or of joint targets.

    Raises InputError when the robot's default pose is not its own mirror image: mirrored actions
    would not be mirrored motions.
    """
    image = robot.default_pose[_JOINTS.source] * _JOINTS.sign
    if not np.allclose(image, robot.default_pose, rtol=0.0, atol=1e-9):
        crooked = robot.joint_names[int(np.abs(image - robot.default_pose).argmax())]
        raise InputError(
            f"robot {robot.name}: the default pose is not mirror symmetric, see {crooked}"
        )
    return _JOINTS
