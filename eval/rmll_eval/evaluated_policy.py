"""Which bundle is meant: a shipped one, a file, or one exported for the occasion."""

from dataclasses import dataclass
from pathlib import Path

from rmll_common.errors import InputError
from rmll_common.optional_import import needs
from rmll_gaits.load import is_gait_file, load_gait
from rmll_onboard.control.bundle import load_bundle


@dataclass(frozen=True)
class EvaluatedPolicy:
    """What walks."""

    bundle: Path
    source: Path
    """File that it comes from"""
    told: str = ""
    """Lines for the user: why it is this one, and what was passed over"""


def find(name: str, run: bool, runs: Path, policies: Path, scratch: Path) -> EvaluatedPolicy:
    """The policy of ``name``, which is a gait, a bundle (.onnx) or a checkpoint (.safetensors).

    A gait (of the library, in a file, or what one from a file is called) means its shipped bundle
    in ``policies``, or with ``run`` a run in ``runs``, see :mod:`rmll_export.runs`. What is no
    bundle yet is exported into the folder ``scratch``. Raises InputError if there is none.
    """
    path = Path(name)
    if path.suffix in (".onnx", ".safetensors"):
        if run:
            raise InputError(f"--run takes the name of a gait, found the file {name}")
        return EvaluatedPolicy(path, path) if path.suffix == ".onnx" else _export(path, scratch)
    if not run:
        return _shipped(name, runs, policies)
    with needs("--run", "export"):
        from rmll_export.runs import choose
    chosen = choose(name, runs)
    return _export(chosen.checkpoint, scratch, chosen.told())


def _shipped(name: str, runs: Path, policies: Path) -> EvaluatedPolicy:
    """Raises InputError for a bundle that bears the name of a gait file and has other rules."""
    table = load_gait(name) if is_gait_file(name) else None
    bundle = policies / f"{table.gait if table else name}.onnx"
    hint = f"--run takes the newest finished run in {runs}/"
    if not bundle.is_file():
        known = ", ".join(sorted(path.stem for path in policies.glob("*.onnx"))) or "none"
        raise InputError(f"no {bundle}; there is: {known}; {hint}")
    if table and load_bundle(bundle).table.rules != table.rules:
        raise InputError(f"{bundle} has other rules than {name}; {hint}")
    return EvaluatedPolicy(bundle, bundle)


def _export(checkpoint: Path, scratch: Path, told: str = "") -> EvaluatedPolicy:
    with needs(checkpoint.name, "export"):
        from rmll_export.checkpoint_reader import read
        from rmll_export.export_bundle import export
    target = scratch / "policy.onnx"
    export(read(checkpoint), target)
    return EvaluatedPolicy(target, checkpoint, told)
