"""Libraries that only some uses need, and that are installed on request."""

from collections.abc import Iterator
from contextlib import contextmanager

from .errors import InputError


@contextmanager
def needs_extra(purpose: str, extra: str) -> Iterator[None]:
    """Import libraries in the block; where one is missing, the error says what to install.

    Raises:
        InputError: when one is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(f"{purpose} needs {error.name}: pip install 'tensegraph[{extra}]'") from error
