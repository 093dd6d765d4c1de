"""Files that a command is told to write, checked before its work and not after it."""

from pathlib import Path

from rmll_common.errors import InputError


def output_file(flag: str, wanted: Path, name: str, suffix: str = "") -> Path:
    """The file that ``flag`` means: ``wanted``, or, where that is a folder, ``name`` in it.

    Raises InputError if it cannot be written there, or if its name ends otherwise than ``suffix``,
    which is what will be in it.
    """
    path = wanted / Path(name).name if wanted.is_dir() else wanted
    if (suffix and path.suffix.lower() != suffix) or not path.parent.is_dir():
        what = f"a {suffix} file" if suffix else "a file"
        raise InputError(f"{flag} {wanted}: expected {what} in a folder that exists")
    if path.is_dir():
        raise InputError(f"{flag} {wanted}: {path} is a folder")
    return path
