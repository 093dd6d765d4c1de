"""How every ``rmll-*`` command starts and ends: tyro in front, one line on errors."""

import sys
from collections.abc import Callable
from importlib.metadata import version
from typing import Any, NoReturn

import tyro

from rmll_gaits.errors import Failure, InputError

_STYLE = (tyro.conf.FlagCreatePairsOff,)  # --json, without a --no-json beside it


def run(prog: str, commands: Callable[..., int | None] | dict[str, Callable[..., Any]]) -> NoReturn:
    """Parse ``sys.argv`` and run one command, or one of several named subcommands.

    Every command knows ``--version``, and by tyro ``--tyro-print-completion SHELL``.

    Exit codes: what the command returns (None = 0), 2 for wrong input, 1 for failed work,
    130 for Ctrl-C.
    """
    tell_version(prog)
    try:
        if callable(commands):
            code = tyro.cli(commands, prog=prog, config=_STYLE)
        else:
            code = tyro.extras.subcommand_cli_from_dict(commands, prog=prog, config=_STYLE)
    except InputError as error:
        _end(prog, error, 2)
    except (Failure, OSError) as error:
        _end(prog, error, 1)
    except KeyboardInterrupt:
        _end(prog, "stopped", 130)
    sys.exit(code or 0)


def tell_version(prog: str) -> None:
    """If ``--version`` is all that was asked for, tell it and end."""
    if sys.argv[1:] == ["--version"]:
        print(prog, version("rmll"))
        sys.exit(0)


def _end(prog: str, message: object, code: int) -> NoReturn:
    print(f"{prog}: {' '.join(str(message).split())}", file=sys.stderr)
    sys.exit(code)
