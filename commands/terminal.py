"""What a command says while it works: the one place that knows of --quiet and --verbose."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeElapsedColumn

from ..models.values.errors import TensegraphError


class Terminal:
    """The screen, in three shares of talk; errors are printed by `cli.main` alone.

    Raises:
        TensegraphError: when asked to be quiet and verbose.
    """

    def __init__(self, *, quiet: bool = False, verbose: bool = False) -> None:
        if quiet and verbose:
            raise TensegraphError("--quiet and --verbose: expected one of them, got both")
        self.results = Console()
        """For what was asked for, and where it was written: always shown."""
        self.news = Console(quiet=quiet)
        """For tables, progress and the state of things: not shown with --quiet."""
        self._timing = Console(stderr=True, quiet=not verbose)

    def written(self, text: str) -> None:
        """Say where results are."""
        self.results.print(text, highlight=False, markup=False, soft_wrap=True)

    def line(self, text: str) -> None:
        """Say how things stand."""
        self.news.print(text, highlight=False, markup=False, soft_wrap=True)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time a block; how long it took is shown with --verbose, on stderr."""
        start_s = time.perf_counter()
        yield
        seconds = time.perf_counter() - start_s
        self._timing.print(f"{name}: {seconds:.2f} s", highlight=False, markup=False, soft_wrap=True)

    def progress(self, *more: ProgressColumn, transient: bool = True) -> Progress:
        """Return a progress bar, a context manager; transient ones are gone when they are full."""
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        return Progress(*columns, *more, console=self.news, transient=transient)
