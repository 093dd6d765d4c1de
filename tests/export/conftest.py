"""Runs as rmll-train leaves them, with a shipped policy's weights."""

import os
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from safetensors.numpy import load_file, save_file

from rmll_contract import contract as contracts
from rmll_export.checkpoint_reader import read
from rmll_gaits.load import load_gait

SHIPPED = Path(__file__).parents[2] / "policies"


@pytest.fixture(scope="session")
def checkpoint() -> Callable[..., Path]:
    """Writes the trot's checkpoint as one of another gait, and of a run that came so far."""

    def write(
        path: Path,
        gait: str = "trot",
        rules: str | Path = "trot",
        steps: int = 0,
        shortfalls: tuple[str, ...] = (),
    ) -> Path:
        shipped = SHIPPED / "trot.safetensors"
        contract = read(shipped).contract
        table = load_gait(rules).to_dict() | {"gait": gait}
        provenance = contract.provenance | {
            "steps": steps or contract.provenance["steps"],
            "shortfalls": shortfalls,
        }
        changed = msgspec.structs.replace(
            contract, gait=gait, table=table, provenance=provenance, digest=""
        )
        header = {contracts.KEY: contracts.encode(contracts.seal(changed))}
        path.parent.mkdir(parents=True, exist_ok=True)
        save_file(load_file(shipped), path, metadata=header)
        return path

    return write


@pytest.fixture
def run(tmp_path: Path, checkpoint) -> Callable[..., Path]:
    """Makes the folder runs/GAIT/NAME; of later calls it is newer."""
    clock = iter(range(1_000_000, 2_000_000))

    def make(name: str, finished: bool = True, gait: str = "trot", **how) -> Path:
        policy = checkpoint(tmp_path / "runs" / gait / name / "policy.safetensors", gait, **how)
        now = next(clock)
        os.utime(policy, (now, now))
        if finished:
            result = policy.with_name("result.yaml")
            result.touch()
            os.utime(result, (now, now))
        return policy

    return make
