"""Which bundle is meant: a file, or one that comes with rmll by its name."""

import sys
from pathlib import Path

from rmll_common.errors import InputError

FOLDER = Path("policies")
_SUFFIX = ".onnx"
_CHECKOUT = Path(__file__).parents[3] / FOLDER
"""An installed wheel has no bundles with it"""


def find_policy(policy: Path) -> Path:
    """The file of ``policy``, which is a path, or a shipped bundle's name such as ``trot``.

    A bare name is looked for in ``policies/`` here, then in that of the checkout that runs; a file
    of that name in this folder is passed over, with a line on stderr, for its path is as short:
    ``trot.onnx``. Raises InputError, with the names that there are, for one that there is not.
    """
    name = str(policy)
    here = Path(f"{name}{_SUFFIX}")
    bare = policy.name == name and not policy.suffix
    known = _shipped() if bare else {}
    if name in known:
        if here.is_file():
            told = f"--policy {name} is {known[name]}; the one in this folder is --policy {here}"
            print(told, file=sys.stderr)
        return known[name]
    if bare and not policy.is_file():
        there = ", ".join(sorted(known)) or "none"
        hint = f"in this folder: {here}" if here.is_file() else f"or name a file, {here}"
        raise InputError(f"--policy {name}: no {FOLDER / here}; there is: {there}; {hint}")
    return policy


def _shipped() -> dict[str, Path]:
    files = [*_CHECKOUT.glob(f"*{_SUFFIX}"), *FOLDER.glob(f"*{_SUFFIX}")]
    return {path.stem: path for path in files}
