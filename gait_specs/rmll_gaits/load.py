"""Gaits by name, from the library beside this module, or by path, from the user's file."""

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from rmll_common.errors import InputError
from rmll_common.yaml_document import read_text
from rmll_gaits.compile import compile_gait
from rmll_gaits.spec import GaitSpec, read_spec
from rmll_gaits.table import MachineTable

_SUFFIX = ".yaml"


def load_gait(gait: str | Path) -> MachineTable:
    """The compiled gait of a library name (``trot``) or of a file (``my/gait.yaml``).

    Raises InputError for an unknown name, an unreadable file, or a gait with errors.
    """
    return compile_gait(load_spec(gait))


def load_spec(gait: str | Path) -> GaitSpec:
    """The rules of a gait, not compiled; arguments and errors as :func:`load_gait`."""
    return read_spec(*load_text(gait))


def load_text(gait: str | Path) -> tuple[str, str]:
    """The text of a gait's file, not checked, and what errors call the file."""
    name = str(gait)
    if name in library_names():
        return (_library() / f"{name}{_SUFFIX}").read_text("utf-8"), f"{name}{_SUFFIX}"
    path = Path(gait)
    if not is_gait_file(path):
        known = ", ".join(library_names())
        raise InputError(f"no gait {name!r}, expected one of {known}, or a {_SUFFIX} file")
    return read_text(path), name


def is_gait_file(gait: str | Path) -> bool:
    """Whether a gait is named by its file, which need not be there."""
    return Path(gait).suffix in (_SUFFIX, ".yml")


def library_names() -> tuple[str, ...]:
    """Names of the gaits that come with the package, sorted."""
    files = (entry.name for entry in _library().iterdir())
    return tuple(sorted(name.removesuffix(_SUFFIX) for name in files if name.endswith(_SUFFIX)))


def _library() -> Traversable:
    return resources.files("rmll_gaits.library")
