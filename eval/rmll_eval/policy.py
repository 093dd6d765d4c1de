"""Which bundle is meant: a shipped one, a file, or one exported for the occasion."""

from pathlib import Path

from rmll_eval.extra import needs
from rmll_gaits.errors import InputError


def find(name: str, run: bool, runs: Path, policies: Path, scratch: Path) -> tuple[Path, Path]:
    """The bundle of ``name``, and the file that it comes from.

    ``name`` is a gait, a bundle (.onnx) or a checkpoint (.safetensors). A gait means its shipped
    bundle in ``policies``, or with ``run`` its newest finished run in ``runs``. What is no bundle
    yet is exported into the folder ``scratch``. Raises InputError if there is no such policy.
    """
    path = Path(name)
    if path.suffix in (".onnx", ".safetensors"):
        if run:
            raise InputError(f"--run takes the name of a gait, found the file {name}")
        return (path if path.suffix == ".onnx" else _export(path, scratch)), path
    if run:
        checkpoint = _newest(name, runs)
        return _export(checkpoint, scratch), checkpoint
    shipped = policies / f"{name}.onnx"
    if not shipped.is_file():
        known = ", ".join(sorted(path.stem for path in policies.glob("*.onnx"))) or "none"
        raise InputError(
            f"no {shipped}; there is: {known}; --run takes the newest finished run in {runs}/"
        )
    return shipped, shipped


def _newest(gait: str, runs: Path) -> Path:
    with needs("--run", "export"):
        from rmll_export.checkpoint import newest_run
    checkpoint = newest_run(gait, runs)
    if checkpoint is None:
        known = ", ".join(sorted(path.name for path in runs.glob("*"))) or "none"
        raise InputError(f"no finished run of {gait!r} in {runs}/; there are runs of: {known}")
    return checkpoint


def _export(checkpoint: Path, scratch: Path) -> Path:
    with needs(checkpoint.name, "export"):
        from rmll_export.bundle import export
        from rmll_export.checkpoint import read
    target = scratch / "policy.onnx"
    export(read(checkpoint), target)
    return target
