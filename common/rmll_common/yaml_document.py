"""YAML values that know where they stand, so that every complaint names line and column.

Every YAML file of ours is read here: gaits, settings, fault plans. Only the node tree of
``yaml.SafeLoader`` is used, so nothing in a file is ever constructed or evaluated. Of YAML's
features those are left out with which a file says something else than it seems to: keys given
twice, anchors, aliases, tags, and numbers that not everybody reads alike
(``rmll_common.yaml_scalar``).
"""

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rmll_common import yaml_scalar
from rmll_common.errors import InputError
from rmll_common.yaml_scalar import Scalar

MAX_CHARACTERS = 100_000
"""Of a file; PyYAML takes about a second for so many"""

DEEPEST = 32
"""Values within values"""

_SHOWN = 40
"""Characters of a text that an error shows"""

LARGEST = 1e6
"""Bound of every number, either sign"""

_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True)
class Value:
    """A YAML node of the file ``source``. Every reading method raises InputError."""

    source: str
    node: yaml.Node

    def error(self, problem: str, column: int = 0) -> InputError:
        """An error at this value, or at ``column`` (from 1) of its text."""
        start, end = self.node.start_mark, self.node.end_mark
        at = start.column + 1
        if column and start.line == end.line:
            at += column - 1 + (self.node.style in ("'", '"'))
        return InputError(f"{self.source}:{start.line + 1}:{at}: {problem}")

    def describe(self) -> str:
        """What is there, for "expected ..., found ..."."""
        if self.is_mapping:
            return "a mapping"
        if self.is_list:
            return "a list"
        if self.node.style:
            return f"the text {_shown(self.node.value)}"
        return _shown(self.node.value) if self.node.value else "nothing"

    def mapping(
        self,
        allowed: Collection[str] = (),
        required: Collection[str] = (),
        names: bool = False,
        also: Collection[str] = (),
    ) -> "Mapping":
        """Entries by key: only ``allowed`` keys, or, where it is empty, any texts or ``names``.

        ``also`` may be there too, but is not what is expected.
        """
        if not isinstance(self.node, yaml.MappingNode):
            raise self.error(f"found {self.describe()}, expected a mapping")
        entries: Mapping = {}
        for key_node, value_node in self.node.value:
            key = Value(self.source, key_node)
            name = key.name() if names else key.text()
            if name in entries:
                raise key.error(f"key {_shown(name)} is given twice")
            if allowed and name not in allowed and name not in also:
                known = ", ".join(allowed)
                raise key.error(f"unknown key {_shown(name)}, expected one of {known}")
            entries[name] = Value(self.source, value_node)
        for name in required:
            if name not in entries:
                raise self.error(f"key {name!r} is missing")
        return entries

    def items(self, least: int, most: int) -> list["Value"]:
        """The elements of a list of ``least`` to ``most`` elements."""
        count = len(self.elements())
        if not least <= count <= most:
            wanted = f"{least}" if least == most else f"{least} to {most}"
            raise self.error(f"found a list of {count}, expected {wanted}")
        return self.elements()

    def elements(self) -> list["Value"]:
        """The elements of a list, however many."""
        if not self.is_list:
            raise self.error(f"found {self.describe()}, expected a list")
        return [Value(self.source, node) for node in self.node.value]

    def text(self) -> str:
        """A text that is not blank."""
        if not isinstance(self.node, yaml.ScalarNode):
            raise self.error(f"found {self.describe()}, expected a text")
        if not self.node.value.strip():
            raise self.error("found nothing, expected a text")
        return self.node.value

    def scalar(self) -> Scalar:
        """A text, a finite number, true, false or None."""
        if not isinstance(self.node, yaml.ScalarNode):
            raise self.error(f"found {self.describe()}, expected a single value")
        if self.node.style:  # quoted, or a block
            return self.node.value
        try:
            return yaml_scalar.read(self.node.value)
        except ValueError as error:
            raise self.error(str(error)) from None

    def plain(self) -> Any:
        """Dictionaries by text, lists and scalars."""
        if self.is_mapping:
            return {name: entry.plain() for name, entry in self.mapping().items()}
        return [item.plain() for item in self.elements()] if self.is_list else self.scalar()

    def line(self) -> str:
        """A text made one line, without control characters."""
        line = " ".join(self.text().split())
        if not line.isprintable():
            raise self.error(f"found {self.describe()}, expected printable characters")
        return line

    def name(self) -> str:
        """A name: lower-case letters, digits and underscores."""
        text = self.text()
        if not _NAME.fullmatch(text):
            raise self.error(
                f"{_shown(text)} is no name, expected lower-case letters, digits and _"
            )
        return text

    def number(self, least: float = -LARGEST) -> float:
        """A number from ``least`` to ``LARGEST``."""
        number = None if self.is_list or self.is_mapping else self.scalar()
        if isinstance(number, bool | str | None) or not least <= number <= LARGEST:
            raise self.error(
                f"found {self.describe()}, expected a number from {least:g} to {LARGEST:g}"
            )
        return float(number)

    def count(self) -> int:
        """A whole number, not negative."""
        number = self.number(least=0)
        if not number.is_integer():
            raise self.error(f"found {self.describe()}, expected a whole number")
        return int(number)

    def true(self) -> bool:
        """The constant true, the only value of a key that can also be left out."""
        if self.is_list or self.is_mapping or self.scalar() is not True:
            raise self.error(f"found {self.describe()}, expected true, or no such key")
        return True

    @property
    def where(self) -> str:
        """``file:line:column``, where the value begins."""
        mark = self.node.start_mark
        return f"{self.source}:{mark.line + 1}:{mark.column + 1}"

    @property
    def is_list(self) -> bool:
        return isinstance(self.node, yaml.SequenceNode)

    @property
    def is_mapping(self) -> bool:
        return isinstance(self.node, yaml.MappingNode)


Mapping = dict[str, Value]


class _Loader(yaml.SafeLoader):
    """Nodes as SafeLoader has them, without what :mod:`rmll_common.yaml_document` leaves out."""

    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()
        if event.anchor is not None:
            self._refuse("anchors and aliases are not read, write the value out")
        if tag := getattr(event, "tag", None):
            tag = tag.replace("tag:yaml.org,2002:", "!!")
            self._refuse(f"the tag {_shown(tag)} is not read; quote a text that begins with '!'")
        if self.depth == DEEPEST:
            self._refuse("nested too deeply")
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def _refuse(self, problem: str) -> None:
        raise _LeftOut(problem=problem, problem_mark=self.peek_event().start_mark)


class _LeftOut(yaml.MarkedYAMLError):
    """Well-formed YAML that is not for us."""


def read_text(path: Path) -> str:
    """A file's text, as far as :func:`parse` takes it; InputError if it cannot be read."""
    try:
        with path.open("rb") as file:
            # one byte more than any file may have, in UTF-8
            return file.read(4 * MAX_CHARACTERS + 1).decode("utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text in UTF-8: {error.reason}") from error


def parse(text: str, source: str) -> Value | None:
    """The one YAML document in ``text``, None when there is none; raises InputError."""
    if len(text) > MAX_CHARACTERS:
        raise InputError(f"{source}: {len(text)} characters, at most {MAX_CHARACTERS} allowed")
    try:
        node = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        raise InputError(_explain(text, source, error)) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # characters that YAML forbids
        raise InputError(f"{source}: not YAML: {' '.join(str(error).split())}") from None
    return None if node is None else Value(source, node)


def read(text: str, source: str) -> Value:
    """As :func:`parse`; InputError when there is no document."""
    if (value := parse(text, source)) is None:
        raise InputError(f"{source}: the file is empty")
    return value


def _shown(text: str) -> str:
    return repr(text if len(text) <= _SHOWN else f"{text[:_SHOWN]}...")


def _explain(text: str, source: str, error: yaml.MarkedYAMLError) -> str:
    problem = ", ".join(filter(None, (error.context, error.problem)))
    mark = error.problem_mark or error.context_mark
    if mark is None:
        return f"{source}: not YAML: {problem}"
    where = f"{source}:{mark.line + 1}:{mark.column + 1}"
    if isinstance(error, _LeftOut):
        return f"{where}: {problem}"
    lines = text.splitlines()
    line = lines[mark.line] if mark.line < len(lines) else ""
    hint = "; a formula that begins with '!' needs quotes" if re.search(r":\s*!", line) else ""
    return f"{where}: not YAML: {problem}{hint}"
