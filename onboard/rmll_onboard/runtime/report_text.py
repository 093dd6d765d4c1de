"""A report for people: a line an entry, and what does not fit into one indented beneath it."""

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

WIDTH = 80


def report_text(entries: Mapping[str, Any], width: int = WIDTH) -> str:
    """Plain data as text; only a word that is longer than ``width`` goes beyond it."""
    return "\n".join(_lines(entries, width, indent=0))


def _lines(entries: Mapping[str, Any], width: int, indent: int) -> Iterator[str]:
    column = max(map(len, entries), default=0)
    for name, value in entries.items():
        head = f"{' ' * indent}{name:{column}}  "
        paragraphs = list(_paragraphs(value))
        if isinstance(value, Mapping) and len(head + paragraphs[0]) > width:
            yield head.rstrip()
            yield from _lines(value, width, indent + 2)
            continue
        for paragraph in paragraphs:
            wrapped = textwrap.wrap(
                paragraph, width - len(head), break_long_words=False, break_on_hyphens=False
            )
            for line in wrapped or [""]:
                yield (head + line).rstrip()
                head = " " * len(head)


def _paragraphs(value: Any) -> Iterator[str]:
    """One for most; a list of sentences has one for each."""
    if isinstance(value, list | tuple) and any(isinstance(v, str) and " " in v for v in value):
        yield from map(_plain, value)
    else:
        yield _plain(value)


def _plain(value: Any) -> str:
    match value:
        case Mapping():
            return "  ".join(f"{name} {_plain(inner)}" for name, inner in value.items()) or "-"
        case list() | tuple():
            return " ".join(map(_plain, value)) or "-"
        case float():
            return f"{value:.4g}" if abs(value) < 10_000 else f"{value:.0f}"
        case None:
            return "-"
    return str(value)
