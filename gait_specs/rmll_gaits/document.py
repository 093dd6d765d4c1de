"""YAML values that know where they stand, so that every complaint names line and column.

Only the node tree of ``yaml.SafeLoader`` is used: nothing in a file is ever constructed or
evaluated, and numbers and texts are read where they are expected.
"""

import math
import re
from collections.abc import Collection
from dataclasses import dataclass

import yaml

from rmll_gaits.errors import InputError

MAX_CHARACTERS = 32_768

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
            quoted = isinstance(self.node, yaml.ScalarNode) and self.node.style in ("'", '"')
            at += column - 1 + quoted
        return InputError(f"{self.source}:{start.line + 1}:{at}: {problem}")

    def describe(self) -> str:
        """What is there, for "expected ..., found ..."."""
        if isinstance(self.node, yaml.MappingNode):
            return "a mapping"
        if isinstance(self.node, yaml.SequenceNode):
            return "a list"
        if self.node.tag.startswith("!"):
            return f"the YAML tag {self.node.tag} (quote a text that begins with '!')"
        return repr(self.node.value) if self.node.value else "nothing"

    def mapping(self, allowed: Collection[str] = (), required: Collection[str] = ()) -> "Mapping":
        """Entries by key: only ``allowed`` keys, or, where it is empty, any names."""
        if not isinstance(self.node, yaml.MappingNode):
            raise self.error(f"found {self.describe()}, expected a mapping")
        entries: Mapping = {}
        for key_node, value_node in self.node.value:
            key = Value(self.source, key_node)
            name = key.text() if allowed else key.name()
            if name in entries:
                raise key.error(f"key {name!r} is given twice")
            if allowed and name not in allowed:
                raise key.error(f"unknown key {name!r}, expected one of {', '.join(allowed)}")
            entries[name] = Value(self.source, value_node)
        for name in required:
            if name not in entries:
                raise self.error(f"key {name!r} is missing")
        return entries

    def items(self, least: int, most: int) -> list["Value"]:
        """The elements of a list of ``least`` to ``most`` elements."""
        if not self.is_list:
            raise self.error(f"found {self.describe()}, expected a list")
        count = len(self.node.value)
        if not least <= count <= most:
            wanted = f"{least}" if least == most else f"{least} to {most}"
            raise self.error(f"found a list of {count}, expected {wanted}")
        return [Value(self.source, node) for node in self.node.value]

    def text(self) -> str:
        """A text that is not blank."""
        if not isinstance(self.node, yaml.ScalarNode) or self.node.tag.startswith("!"):
            raise self.error(f"found {self.describe()}, expected a text")
        if not self.node.value.strip():
            raise self.error("found nothing, expected a text")
        return self.node.value

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
            raise self.error(f"{text!r} is no name, expected lower-case letters, digits and _")
        return text

    def number(self, least: float = -LARGEST) -> float:
        """A number from ``least`` to ``LARGEST``."""
        try:
            number = float(self.text())
        except (InputError, ValueError):
            number = math.nan
        if not least <= number <= LARGEST:
            raise self.error(
                f"found {self.describe()}, expected a number from {least:g} to {LARGEST:g}"
            )
        return number

    def count(self) -> int:
        """A whole number, not negative."""
        number = self.number(least=0)
        if not number.is_integer():
            raise self.error(f"found {self.describe()}, expected a whole number")
        return int(number)

    def true(self) -> bool:
        """The constant true, the only value of a key that can also be left out."""
        if self.text() != "true":
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


def read(text: str, source: str) -> Value:
    """The one YAML document in ``text``; InputError when there is none."""
    if len(text) > MAX_CHARACTERS:
        raise InputError(f"{source}: {len(text)} characters, at most {MAX_CHARACTERS} allowed")
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        raise InputError(_explain(text, source, error)) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # characters that YAML forbids
        raise InputError(f"{source}: not YAML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise InputError(f"{source}: nested too deeply") from None
    if node is None:
        raise InputError(f"{source}: the file is empty")
    return Value(source, node)


def _explain(text: str, source: str, error: yaml.MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    if mark is None:
        return f"{source}: not YAML: {error.problem}"
    lines = text.splitlines()
    line = lines[mark.line] if mark.line < len(lines) else ""
    hint = "; a formula that begins with '!' needs quotes" if re.search(r":\s*!", line) else ""
    return f"{source}:{mark.line + 1}:{mark.column + 1}: not YAML: {error.problem}{hint}"
