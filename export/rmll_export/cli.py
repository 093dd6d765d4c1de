"""The ``rmll-export`` command."""

import sys
from json import JSONDecodeError, dumps, loads
from pathlib import Path
from typing import Annotated, Any

import tyro

from rmll_common import command_line
from rmll_common.errors import InputError
from rmll_common.output_file import output_file
from rmll_export.card import MEASURED
from rmll_export.card import card as write_card
from rmll_export.checkpoint_reader import read
from rmll_export.export_bundle import export
from rmll_export.runs import Choice, as_named, choose


def main() -> None:
    command_line.run("rmll-export", _export)


def _export(
    name: Annotated[str, tyro.conf.Positional] = "",
    *,
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

    Takes the gait's newest finished run, else its shipped checkpoint, else its newest run; a run
    counts if its rules are the gait's. What was taken and what was passed over is told on stderr.
    Example: rmll-export trot          (writes trot.onnx)

    Args:
        name: a gait of the library, a gait file, what a gait from a file is called, or a run's
            folder.
        gait: the same, as a flag.
        checkpoint: a policy.safetensors to export instead; with a gait it has to be of its name.
        out: file to write, or folder for it; GAIT.onnx in this folder by default.
        runs: where rmll-train puts its runs.
        policies: where the shipped checkpoints are.
        card: also write the policy's card, in Markdown, to this file, or GAIT.md in this folder.
        evaluations: what rmll-eval gait --json printed, to be shown on the card.
        json: print one JSON object.
    """
    if name and gait and name != gait:
        raise InputError(f"two gaits, {name} and --gait {gait}: name one")
    gait = name or gait
    chosen = _chosen(gait, checkpoint, runs, policies)
    source = chosen.checkpoint
    trained = read(source)
    held = trained.contract.gait
    target = output_file("--out", out or Path(), f"{held}.onnx")
    card = card and output_file("--card", card, f"{held}.md")
    print(chosen.told(), file=sys.stderr)
    measured = [_evaluation(path) for path in evaluations]
    difference = export(trained, target)
    if card is not None:
        card.write_text(write_card(trained.contract, target.name, measured))
    report = {
        "bundle": str(target),
        "checkpoint": str(source),
        "why": chosen.why,
        "passed_over": chosen.passed_over,
        "shortfalls": chosen.shortfalls,
        "gait": held,
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


def _chosen(gait: str, checkpoint: Path | None, runs: Path, policies: Path) -> Choice:
    """The checkpoint that is named, which has to be of the gait that is named beside it."""
    if checkpoint is None:
        if not gait:
            raise InputError(
                "name a gait (rmll-export trot) or a file (--checkpoint policy.safetensors)"
            )
        return choose(gait, runs, policies)
    return as_named(checkpoint, gait)


def _evaluation(path: Path) -> dict[str, Any]:
    try:
        found = loads(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, JSONDecodeError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    if not isinstance(found, dict) or not {*MEASURED, "world", "ground"} <= found.keys():
        raise InputError(f"{path}: not what rmll-eval gait --json prints")
    return found


if __name__ == "__main__":
    main()
