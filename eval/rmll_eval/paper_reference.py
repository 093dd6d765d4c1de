"""The paper's own figures, to stand beside ours."""

from dataclasses import dataclass

STEP = 0.02
"""[s] The authors' code sums |torque x speed| over policy steps without their length"""


@dataclass(frozen=True)
class Reference:
    """Energy per metre of one gait on flat ground."""

    energy_per_metre: float
    """[J/m]"""
    vx: tuple[float, float]
    """[m/s] speeds at which it was measured"""


_FAST, _SLOW = (0.5, 1.0), (0.25, 0.5)
FLAT = {
    "trot": Reference(2165.04 * STEP, _FAST),
    "bound": Reference(4657.94 * STEP, _FAST),
    "pace": Reference(2998.95 * STEP, _FAST),
    "walk": Reference(4271.82 * STEP, _SLOW),
    "three_one": Reference(3145.81 * STEP, _FAST),
    "half_bound": Reference(4873.29 * STEP, _FAST),
}
"""*Learning Quadruped Locomotion Policies using Logical Rules* (AAAI-24), energy on flat ground,
20,000 s a policy, frequencies over the training range"""
