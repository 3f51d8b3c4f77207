"""Everything that tensegraph raises on purpose.

TensegraphError
├── InputError           a file, a value or a setting is not what it must be
├── RecordingError       a recording that has begun cannot be continued
└── IndeterminateError   the measurements and priors do not determine the shape
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LONGEST_ERROR = 900
"""Number of characters of an error that a user still reads."""


class TensegraphError(Exception):
    """Base of all errors raised on purpose; its text is one line that says what to do."""


class InputError(TensegraphError):
    """A file, a value or a setting is not what it must be: the text says where, what was expected, and what it got."""


class RecordingError(TensegraphError):
    """A recording that has begun cannot be continued: the text names the trial and the operating system's reason."""


class IndeterminateError(TensegraphError):
    """The measurements and priors of a frame do not determine its shape: the text names the reason."""


UNDETERMINED = "a node is undetermined: too few lengths, or settings of which one is far more certain than another"
"""What a matrix without an inverse means."""


@contextmanager
def needs_extra(purpose: str, extra: str) -> Iterator[None]:
    """Import, in the block, libraries that only some uses need; where one is missing, the error says what to install.

    Raises:
        InputError: when one is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(f"{purpose} needs {error.name}: pip install 'tensegraph[{extra}]'") from error


@contextmanager
def naming(path: Path, *others: Path) -> Iterator[None]:
    """Name a file or a directory in errors that name none, as where two files of a directory contradict each other.

    Args:
        path: the file or the directory.
        others: other files that an error of the block may be of, and then begins with.
    """
    try:
        yield
    except TensegraphError as error:
        text = str(error)
        if any(begins_with(text, one) for one in (path, *others)):
            raise
        raise type(error)(f"{path}: {text}") from error


def begins_with(text: str, path: Path) -> bool:
    """Return whether an error's text begins with a file or a directory, or with a file in it."""
    return text.startswith((f"{path}:", f"{path}{os.sep}"))


def reason_of(error: Exception) -> str:
    """Return why a file cannot be read, in words that are no programmer's."""
    if isinstance(error, UnicodeDecodeError):
        return f"expected text in UTF-8, got {error.reason}"
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def one_line(error: TensegraphError | OSError) -> str:
    """Return an error as the line that a user reads.

    What of a file or a name cannot be printed is escaped, and what is too long to be read is left out in the middle.
    """
    name = f"{error.filename}: " if isinstance(error, OSError) and error.filename else ""
    line = printable(f"{name}{reason_of(error)}")
    half = LONGEST_ERROR // 2
    return line if len(line) <= LONGEST_ERROR else f"{line[:half]} ... {line[-half:]}"


def printable(text: str) -> str:
    """Return a text in which what cannot be printed is escaped, as of a file whose name is of another encoding."""
    return "".join(one if one.isprintable() else repr(one)[1:-1] for one in text)
