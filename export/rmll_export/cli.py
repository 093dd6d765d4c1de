"""The ``rmll-export`` command."""

from json import JSONDecodeError, dumps, loads
from pathlib import Path
from typing import Any

from rmll_contract import command
from rmll_export.bundle import export
from rmll_export.card import MEASURED
from rmll_export.card import card as write_card
from rmll_export.checkpoint import find, read
from rmll_gaits.errors import InputError


def main() -> None:
    command.run("rmll-export", _export)


def _export(
    gait: str = "",
    checkpoint: Path | None = None,
    out: Path | None = None,
    runs: Path = Path("runs"),
    policies: Path = Path("policies"),
    card: Path | None = None,
    evaluations: tuple[Path, ...] = (),
    json: bool = False,
) -> None:
    """Export a trained gait as one bundle, and prove it against the learner's network.

    Takes the newest finished run of the gait, else the shipped checkpoint.
    Example: rmll-export --gait trot          (writes trot.onnx)

    Args:
        gait: name of the gait.
        checkpoint: a policy.safetensors to export instead.
        out: file to write; GAIT.onnx in this folder by default.
        runs: where rmll-train puts its runs.
        policies: where the shipped checkpoints are.
        card: also write the policy's card, in Markdown, to this file.
        evaluations: what rmll-eval gait --json printed, to be shown on the card.
        json: print one JSON object.
    """
    if not gait and checkpoint is None:
        raise InputError("name a gait (--gait trot) or a file (--checkpoint policy.safetensors)")
    source = checkpoint or find(gait, runs, policies)
    trained = read(source)
    if gait and trained.contract.gait != gait:
        raise InputError(f"{source}: holds gait {trained.contract.gait!r}, expected {gait!r}")
    target = out or Path(f"{trained.contract.gait}.onnx")
    if not target.parent.is_dir():
        raise InputError(f"{target}: its folder does not exist")
    measured = [_evaluation(path) for path in evaluations]
    difference = export(trained, target)
    if card is not None:
        card.write_text(write_card(trained.contract, target.name, measured))
    report = {
        "bundle": str(target),
        "checkpoint": str(source),
        "gait": trained.contract.gait,
        "steps": trained.contract.provenance.get("steps"),
        "difference_from_learner": difference,
        "bytes": target.stat().st_size,
    }
    if json:
        print(dumps(report))
    else:
        print(
            f"{target}: {report['gait']} from {source}, {report['bytes'] / 1e6:.2f} MB, "
            f"within {difference:.1e} of the learner"
        )


def _evaluation(path: Path) -> dict[str, Any]:
    try:
        found = loads(path.read_text())
    except (OSError, UnicodeDecodeError, JSONDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    if not isinstance(found, dict) or not {*MEASURED, "world", "ground"} <= found.keys():
        raise InputError(f"{path}: not what rmll-eval gait --json prints")
    return found


if __name__ == "__main__":
    main()
