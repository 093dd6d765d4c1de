"""The card of a shipped policy: how it came to be and what it was measured to do."""

from collections.abc import Mapping
from typing import Any

from rmll_contract.contract import Contract


def card(contract: Contract, bundle: str, hil: Mapping[str, Any] | None) -> str:
    """Markdown; ``hil`` is the summary.json of an ``rmll-hil run`` with this bundle, if any."""
    origin = contract.provenance
    rows = {
        "robot": contract.robot,
        "observation": f"{contract.profile} profile, "
        f"{sum(field.size for field in contract.observation)} numbers + estimates",
        "environment steps": f"{origin['steps']:,}",
        "minutes of training": origin["minutes"],
        "simulated robots": origin["settings"]["world"]["envs"],
        "seed": origin["seed"],
        "commit": f"`{origin['commit']}`",
        "trained by": f"{origin['trained_by']}, torch {origin['torch']}, MuJoCo {origin['mujoco']}",
        "failed simulations, skipped optimiser steps": f"{origin['failed_simulations']}, "
        f"{origin['skipped_steps']}",
    }
    parts = [
        f"# {contract.gait}\n\nBundle: `{bundle}`. All settings of the run are inside it: "
        f"`rmll-onboard --check --policy {bundle} --json`.\n",
        _table("training", rows),
        "In the trainer's world, without exploration, over the gait's whole range of commands, "
        "with noise and pushes:\n",
        _table("metric", origin.get("metrics", {})),
    ]
    if hil:
        parts += [
            "Through the daemon in the emulator (`rmll-hil run`):\n",
            _table("metric", {k: v for k, v in hil.items() if not isinstance(v, dict)}),
        ]
    return "\n".join(parts)


def _table(title: str, rows: Mapping[str, Any]) -> str:
    lines = [f"| {title} | |", "|---|---|", *(f"| {k} | {_plain(v)} |" for k, v in rows.items())]
    return "\n".join(lines) + "\n"


def _plain(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
