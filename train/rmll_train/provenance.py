"""Where a policy comes from: the code, the seed and the settings that made it."""

import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from rmll_train.settings import Settings


def origin(settings: Settings) -> dict[str, Any]:
    """Plain values; to be asked for when a run begins, for the code may change while it trains."""
    return {
        "trained_by": f"rmll {version('rmll')}",
        "commit": _commit(),
        "seed": settings.seed,
        "torch": version("torch"),
        "mujoco": version("mujoco"),
        "settings": msgspec.to_builtins(settings),
    }


def _commit() -> str:
    """Commit of the source tree, with "+" if it was changed since; "unknown" outside git."""
    here = Path(__file__).parent
    call = ["git", "-C", str(here), "describe", "--always", "--abbrev=40", "--dirty=+"]
    try:
        return subprocess.run(call, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
