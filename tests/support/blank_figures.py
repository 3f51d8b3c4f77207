"""Figures without pixels, or not even composed: they take most of the time of a command on a short trial."""

import importlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import chain, repeat
from pathlib import Path
from unittest import mock

from matplotlib.figure import Figure

WRITERS = {
    "tensegraph.io.figures.shape_figures": ("lengths", "shape", "drift"),
    "tensegraph.commands.evaluate": ("heights", "errors", "loads"),
}
"""Where the functions are looked up that write the figures of every result, and of what; each has many panels."""


@contextmanager
def blank_figures() -> Iterator[None]:
    """Compose figures in this process as ever, and write an empty file in place of what would be drawn."""
    with mock.patch.object(Figure, "savefig", lambda figure, path, **_: Path(path).write_bytes(b"")):
        yield


@contextmanager
def figures_of_the_first_result() -> Iterator[None]:
    """Write empty files in place of figures, and compose of those that every result has only the first of each."""
    with ExitStack() as patches:
        for module, figures in WRITERS.items():
            for figure in figures:
                write = getattr(importlib.import_module(module), f"write_{figure}_figure")
                patches.enter_context(mock.patch(f"{module}.write_{figure}_figure", side_effect=_once(write)))
        patches.enter_context(blank_figures())
        yield


def _once(write: Callable[..., None]) -> Callable[..., None]:
    """Return what writes a figure the first time that it is called, and an empty file from then on."""
    writers = chain([write], repeat(_write_nothing))
    return lambda *arguments: next(writers)(*arguments)


@contextmanager
def no_figures() -> Iterator[None]:
    """Write an empty file in place of each figure, and do not compose those that every result has."""
    with ExitStack() as patches:
        for module, figures in WRITERS.items():
            for figure in figures:
                patches.enter_context(mock.patch(f"{module}.write_{figure}_figure", _write_nothing))
        patches.enter_context(blank_figures())
        yield


def _write_nothing(*arguments: object) -> None:
    """Write an empty file at the path, which is the last argument of the functions that write figures."""
    Path(str(arguments[-1])).write_bytes(b"")
