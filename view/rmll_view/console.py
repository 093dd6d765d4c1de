"""Where commands print: text as it is, for the brackets of a unit, a path or a joint's number would
be markup to rich, and vanish."""

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn


def console(*, stderr: bool = False) -> Console:
    """One that styles only what is told to be styled."""
    return Console(stderr=stderr, markup=False, emoji=False, highlight=False)


def bar(*columns: ProgressColumn) -> Progress:
    """A bar on stderr between its description and ``columns``; it vanishes when all is done."""
    description = TextColumn("{task.description}", markup=False)
    messages = console(stderr=True)
    return Progress(description, BarColumn(), *columns, console=messages, transient=True)
