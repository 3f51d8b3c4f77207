"""Figures without pixels: drawing takes most of the time of a command on a short trial."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

from matplotlib.figure import Figure


@contextmanager
def blank_figures() -> Iterator[None]:
    """Compose figures in this process as ever, and write an empty file in place of what would be drawn."""
    with mock.patch.object(Figure, "savefig", lambda figure, path, **_: Path(path).write_bytes(b"")):
        yield
