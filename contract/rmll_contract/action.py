"""From a policy's action to joint targets; runs on NumPy arrays and torch tensors alike."""

from typing import Any


def targets(action: Any, default_pose: Any, scale: float, clip: float) -> Any:
    """Joint targets [rad] (..., 12) = default pose + scale * action, the action clipped first."""
    return default_pose + scale * action.clip(-clip, clip)
