"""How every ``rmll-*`` command starts and ends: tyro in front, one line on errors."""

import os
import select
import signal
import sys
from collections.abc import Callable
from importlib.metadata import version
from io import TextIOWrapper
from typing import Any, NoReturn

import tyro

from rmll_common.errors import Failure, InputError

BROKEN_PIPE = 128 + signal.SIGPIPE
"""Exit code, as a shell has it for a program that the signal ended"""
_STYLE = (tyro.conf.FlagCreatePairsOff,)  # --json, without a --no-json beside it


def run(prog: str, commands: Callable[..., int | None] | dict[str, Callable[..., Any]]) -> NoReturn:
    """Parse ``sys.argv`` and run one command, or one of several named subcommands.

    Every command knows ``--version``, and by tyro ``--tyro-print-completion SHELL``.

    Exit codes: what the command returns (None = 0), 2 for wrong input, 1 for failed work,
    130 for Ctrl-C, 141 if nobody reads what it prints.
    """
    tell_version(prog)
    _open_outputs()
    try:
        if callable(commands):
            code = tyro.cli(commands, prog=prog, config=_STYLE)
        else:
            code = tyro.extras.subcommand_cli_from_dict(commands, prog=prog, config=_STYLE)
        sys.stdout.flush()
    except InputError as error:
        _end(prog, error, 2)
    except Failure as error:
        _end(prog, error, 1)
    except OSError as error:
        unread = isinstance(error, BrokenPipeError) and _is_unread()
        if unread:  # whoever reads has had enough, such as head
            sys.exit(BROKEN_PIPE)
        _end(prog, said(error), 1)
    except KeyboardInterrupt:
        stopped(prog)
    sys.exit(code or 0)


def _open_outputs() -> None:
    """Whatever is printed goes somewhere, also if it was closed (``>&-``), or if a terminal lacks
    the letters of a picture."""
    # in this order, for each takes the lowest number that is free
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def tell_version(prog: str) -> None:
    """If ``--version`` is all that was asked for, tell it and end."""
    if sys.argv[1:] == ["--version"]:
        print(prog, version("rmll"))
        sys.exit(0)


def stopped(prog: str) -> NoReturn:
    """How a command ends that Ctrl-C stopped."""
    _end(prog, "stopped", 130)


def said(error: OSError) -> str:
    """What the system says, and of which file, without its number."""
    files = [str(name) for name in (error.filename, error.filename2) if name is not None]
    told = error.strerror or str(error)
    return f"{' to '.join(files)}: {told}" if files else told


def _is_unread() -> bool:
    """Whether nobody reads what is printed; if so, the rest is thrown away."""
    watch = select.poll()
    watch.register(sys.stdout, 0)
    if unread := bool(watch.poll(0)):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return unread


def _end(prog: str, message: object, code: int) -> NoReturn:
    print(f"{prog}: {' '.join(str(message).split())}", file=sys.stderr)
    sys.exit(code)
