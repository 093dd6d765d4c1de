"""YAML files as structs: settings and fault plans, each mistake with its line and column.

The kinds are msgspec's: structs and dataclasses whose types say what is allowed.
"""

import re
import sys
from collections.abc import Collection
from dataclasses import is_dataclass
from pathlib import Path
from types import UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec
import yaml

from rmll_common import yaml_document, yaml_scalar
from rmll_common.errors import InputError
from rmll_common.yaml_document import Value

T = TypeVar("T")


def load(path: Path, base: T) -> T:
    """``base`` with what a file names changed; raises InputError."""
    return parse(yaml_document.read_text(path), str(path), base)


def parse(text: str, source: str, base: T) -> T:
    """``base`` with what a YAML text names changed; ``source`` is what errors call it."""
    value = yaml_document.parse(text, source)
    return base if value is None else convert(value, type(base), base)


def convert(value: Value, kind: Any, base: Any = None) -> Any:
    """``value`` as a ``kind``. What a mapping leaves out is ``base``'s, or has its default.

    Raises InputError for an unknown name, a wrong type or a value out of range.
    """
    if known := _fields(kind):
        plain = {name: getattr(base, name) for name in known} if base is not None else {}
        for name, entry in _renamed(value, kind, known).items():
            plain[name] = convert(entry, known[name], plain.get(name))
    elif get_origin(_bare(kind)) is dict and value.is_mapping:
        of = get_args(_bare(kind))[1]
        plain = {name: convert(entry, of) for name, entry in value.mapping().items()}
    else:
        plain = value.plain()
    try:
        return msgspec.convert(plain, kind)
    except msgspec.ValidationError as error:
        raise _refused(value, kind, str(error)) from None


def _renamed(value: Value, kind: Any, known: Collection[str]) -> dict[str, Value]:
    """The entries of a mapping, those of an old name under the new one; each is told.

    A kind names its old names in a class variable ``RENAMED``, old to new.
    """
    renamed = getattr(_bare(kind), "RENAMED", {})
    entries = value.mapping(allowed=known, also=renamed)
    for old in [name for name in entries if name in renamed]:
        new, entry = renamed[old], entries.pop(old)
        if new in entries:
            raise entry.error(f"{old!r} is the old name of {new!r}, which is given too")
        print(entry.error(f"{old!r} is called {new!r} now"), file=sys.stderr)
        entries[new] = entry
    return entries


def dump(plain: Any, **style: Any) -> str:
    """YAML that reads back as the same. ``plain`` is what :func:`msgspec.to_builtins` gives."""
    return yaml.dump(plain, Dumper=_Dumper, sort_keys=False, **style)


class _Dumper(yaml.SafeDumper):
    """Puts quotes around texts that YAML 1.1 or 1.2 would read as something else."""

    def resolve(self, kind: Any, value: Any, implicit: Any) -> str:
        tag = super().resolve(kind, value, implicit)
        if kind is yaml.ScalarNode and tag == _TEXT and implicit[0] and not _is_text(value):
            return _NO_TEXT
        return tag

    def ignore_aliases(self, data: Any) -> bool:
        return True  # aliases are not read


_TEXT, _NO_TEXT = "tag:yaml.org,2002:str", "tag:yaml.org,2002:float"


def _is_text(plain: str) -> bool:
    try:
        return isinstance(yaml_scalar.read(plain), str)
    except ValueError:
        return False


def _fields(kind: Any) -> dict[str, Any]:
    """Names and types of what a struct or a dataclass holds; nothing for anything else."""
    bare = _bare(kind)
    if not (isinstance(bare, type) and (is_dataclass(bare) or issubclass(bare, msgspec.Struct))):
        return {}
    tag = getattr(bare, "__struct_config__", None) and bare.__struct_config__.tag_field
    hints = get_type_hints(bare, include_extras=True)
    fields = {name: hint for name, hint in hints.items() if get_origin(hint) is not ClassVar}
    return ({tag: str} if tag else {}) | fields


def _bare(kind: Any) -> Any:
    """Without the limits of an Annotated."""
    return _bare(kind.__origin__) if get_origin(kind) is Annotated else kind


def _refused(value: Value, kind: Any, complaint: str) -> InputError:
    """msgspec's complaint in words of ours, at the value or at the element that is meant."""
    problem, _, path = complaint.partition(" - at ")
    if (element := re.match(r"`\$\[(\d+)\]", path)) and value.is_list:
        value = value.elements()[int(element[1])]
    if choices := _choices(kind):
        problem = f"Expected one of {', '.join(map(_written, choices))}"
    if problem.startswith("Expected "):
        expected = problem.removeprefix("Expected ").partition(", got `")[0]
        problem = f"found {value.describe()}, expected {_QUOTED.sub(_worded, expected)}"
    return value.error(_MISSING.sub(r"key '\1' is missing", problem))


_MISSING = re.compile(r"Object missing required field `(.*)`")
_QUOTED = re.compile(r"`([^`]*)`")
_WORDS = {
    "str": "a text in quotes",
    "int": "a whole number",
    "float": "a number",
    "array": "a list",
    "object": "a mapping",
}


def _worded(kind: re.Match[str]) -> str:
    """msgspec's name of a type, in words."""
    return " or ".join(_WORDS.get(part, part) for part in kind[1].split(" | "))


def _written(choice: Any) -> str:
    return str(choice).lower() if isinstance(choice, bool) else str(choice)


def _choices(kind: Any) -> list[Any]:
    """What a Literal allows, also one beside a bool."""
    bare = _bare(kind)
    if bare is bool:
        return [True, False]
    if get_origin(bare) is Literal:
        return list(get_args(bare))
    if get_origin(bare) in (Union, UnionType):
        found = [_choices(part) for part in get_args(bare)]
        return [choice for choices in found for choice in choices] if all(found) else []
    return []
