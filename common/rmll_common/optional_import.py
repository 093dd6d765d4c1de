"""Parts of the command that need more than it does itself."""

from collections.abc import Iterator
from contextlib import contextmanager

from rmll_common.errors import Failure


@contextmanager
def needs(what: str, extra: str) -> Iterator[None]:
    """Around imports: a library that is not there becomes one line that names what to install."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name and error.name.startswith("rmll_"):
            raise
        raise Failure(
            f"{what}: {error.name} is not installed; run: pip install 'rmll[{extra}]'"
        ) from error
