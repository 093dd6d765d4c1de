"""Entry points of the commands that need more than the base install.

A robot's computer has only the base: there, the others say in one line what to install.
"""

import sys
from importlib import import_module

from rmll_common.command_line import stopped, tell_version


def gait() -> None:
    _start("rmll-gait", "rmll_view.gait_cli", "view")


def train() -> None:
    _start("rmll-train", "rmll_train.cli", "train")


def export() -> None:
    _start("rmll-export", "rmll_export.cli", "export")


def hil() -> None:
    _start("rmll-hil", "rmll_hil.cli", "hil")


def evaluate() -> None:
    _start("rmll-eval", "rmll_eval.cli", "hil")


def _start(prog: str, module: str, extra: str) -> None:
    tell_version(prog)
    try:
        command = import_module(module)
    except ModuleNotFoundError as error:
        if error.name and error.name.startswith("rmll_"):
            raise
        sys.exit(_missing(prog, str(error.name), extra))
    except KeyboardInterrupt:  # torch takes seconds to load
        stopped(prog)
    command.main()


def _missing(prog: str, library: str, extra: str) -> int:
    print(f"{prog}: {library} is not installed; run: pip install 'rmll[{extra}]'", file=sys.stderr)
    return 1
