"""When a gait is useful: it keeps its rhythm, goes where it is told, and does not fall.

Adherence alone says nothing of a robot that steps on the spot.
"""

from collections.abc import Mapping

from rmll_gaits.table import Commands

ADHERENCE = 0.95
VX_SHARE, WZ_SHARE = 0.2, 0.6
"""Of the errors of a robot that stands still: 0.10 m/s where commands are drawn from -1 to 1"""
MOST_WZ = 0.2
"""[rad/s] of error at most, however fast a gait turns: much of it is sway within a step"""
LEAST_VX, LEAST_WZ = 0.05, 0.1
"""[m/s], [rad/s] of error that are allowed in any case: a gait may have no turns at all"""


def standing_error(commanded: tuple[float, float]) -> float:
    """Mean absolute error of a robot that stands still, its commands drawn from this range."""
    low, high = commanded
    if low * high >= 0:
        return abs(low + high) / 2
    return (low * low + high * high) / (2 * (high - low))


def share(error: float, commanded: tuple[float, float]) -> float:
    """The error as a share of :func:`standing_error`; infinite where only standing is asked for."""
    standing = standing_error(commanded)
    return error / standing if standing else float("inf")


def shortfalls(metrics: Mapping[str, float], commands: Commands) -> list[str]:
    """What keeps a policy with these metrics from being useful, in words; empty if it is."""
    vx = max(VX_SHARE * standing_error(commands.vx), LEAST_VX)
    wz = min(max(WZ_SHARE * standing_error(commands.wz), LEAST_WZ), MOST_WZ)
    # written so that NaN falls short
    checks = (
        (metrics["adherence"] >= ADHERENCE,
         f"adherence {metrics['adherence']:.3f}, at least {ADHERENCE} wanted"),
        (metrics["vx_error"] <= vx,
         f"vx error {metrics['vx_error']:.3f} m/s, at most {vx:.2f} wanted"),
        (metrics["wz_error"] <= wz,
         f"wz error {metrics['wz_error']:.3f} rad/s, at most {wz:.2f} wanted"),
        (metrics["falls"] == 0, f"falls: {metrics['falls']:.0f}, none wanted"),
    )  # fmt: skip
    return [text for met, text in checks if not met]
