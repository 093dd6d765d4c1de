"""The card of a shipped policy: how it came to be and what it was measured to do."""

from collections.abc import Mapping, Sequence
from typing import Any

from rmll_contract.contract import Contract
from rmll_contract.usefulness import shortfalls
from rmll_gaits.table import Commands, MachineTable

_WORLDS = {
    "emulator": "Through the daemon in the emulator",
    "trainer": "In the trainer's world",
}
_MEASURED_BEFORE = "over the gait's whole range of commands, with noise and pushes"
"""Where a policy's metrics come from that does not say so itself"""
MEASURED = (
    "adherence", "off_spec_contact", "vx_error", "wz_error", "energy_per_metre",
    "cost_of_transport",
)  # fmt: skip
"""What an evaluation has a mean and a worst value of"""


def card(contract: Contract, bundle: str, evaluations: Sequence[Mapping[str, Any]]) -> str:
    """Markdown; ``evaluations`` are what ``rmll-eval gait --json`` printed of this bundle."""
    origin, commands = contract.provenance, MachineTable.from_dict(contract.table).commands
    where = origin.get("measured", _MEASURED_BEFORE)
    rows = {
        "robot": contract.robot,
        "observation": f"{contract.profile} profile, "
        f"{sum(field.size for field in contract.observation)} numbers + estimates",
        "environment steps": f"{origin['steps']:,}",
        "minutes of training": origin["minutes"],
        "simulated robots": origin["settings"]["world"]["envs"],
        "seed": origin["seed"],
        "commit": f"`{origin['commit']}`",
        **_stages(origin.get("stages", [])),
        "trained by": f"{origin['trained_by']}, torch {origin['torch']}, MuJoCo {origin['mujoco']}",
        "failed simulations, skipped optimiser steps": f"{origin['failed_simulations']}, "
        f"{origin['skipped_steps']}",
    }
    parts = [
        f"# {contract.gait}\n\nBundle: `{bundle}`. All settings of the run are inside it: "
        f"`rmll-onboard --check --policy {bundle} --json`.\n",
        _table("training", rows),
        f"In the trainer's world, without exploration, {where}:\n",
        _table("metric", origin.get("metrics", {})),
    ]
    for evaluation in evaluations:
        where = _WORLDS[evaluation["world"]]
        parts += [f"{where} (`{_call(evaluation)}`):\n", _measured(evaluation, commands)]
    return "\n".join(parts)


def _stages(stages: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """A row for the part of a run that had other code or settings, if there is one."""
    told = [f"up to step {stage['steps']:,} at `{stage['commit']}`" for stage in stages]
    return {"with other code or settings": ", ".join(told)} if told else {}


def _call(evaluation: Mapping[str, Any]) -> str:
    """The command that gives this evaluation."""
    flags = [f"--episodes {evaluation['episodes']}", f"--seconds {evaluation['seconds']:g}"]
    if evaluation["world"] != "emulator":
        flags.append(f"--world {evaluation['world']}")
    if evaluation["ground"] != "flat":
        flags.append(f"--ground {evaluation['ground']} --level {evaluation['level']}")
    if evaluation["pushes"]:
        flags.append("--pushes")
    return f"rmll-eval gait {evaluation['gait']} {' '.join(flags)}"


def _measured(evaluation: Mapping[str, Any], commands: Commands) -> str:
    lines = ["| metric | mean | worst walk |", "|---|---|---|"]
    for name in MEASURED:
        found = evaluation[name]
        lines.append(f"| {name} | {_plain(found['mean'])} | {_plain(found['worst'])} |")
    lines.append(f"| falls | {evaluation['falls']} of {evaluation['episodes']} | |")
    if evaluation["faults"]:
        lines.append(f"| faults | {evaluation['faults']} of {evaluation['episodes']} | |")
    if evaluation["ground"] == "flat" and not evaluation["pushes"]:
        means = {name: evaluation[name]["mean"] for name in MEASURED} | {
            "falls": evaluation["falls"]
        }
        lines.append(f"| useful | {'; '.join(shortfalls(means, commands)) or 'yes'} | |")
    if compared := evaluation["energy_at_the_papers_speeds"]:
        low, high = compared["vx"]
        ours, theirs = _plain(compared["energy_per_metre"]), _plain(compared["paper"])
        title = f"energy_per_metre at {low:g} to {high:g} m/s"
        lines.append(f"| {title} | {ours} | the paper: {theirs} |")
    return "\n".join(lines) + "\n"


def _table(title: str, rows: Mapping[str, Any]) -> str:
    lines = [f"| {title} | |", "|---|---|", *(f"| {k} | {_plain(v)} |" for k, v in rows.items())]
    return "\n".join(lines) + "\n"


def _plain(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
