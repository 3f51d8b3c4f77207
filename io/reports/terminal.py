"""The output of commands on the screen, according to --quiet and --verbose."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeElapsedColumn

from ...models.values.errors import TensegraphError


class Terminal:
    """The screen, with output at three levels; errors are printed by `cli.main`.

    Raises:
        TensegraphError: when both quiet and verbose are true.
    """

    def __init__(self, *, quiet: bool = False, verbose: bool = False) -> None:
        if quiet and verbose:
            raise TensegraphError("--quiet and --verbose: expected one of them, got both")
        self.results = Console()
        """Console for requested output and for paths of written files; always shown."""
        self.news = Console(quiet=quiet)
        """Console for tables, progress and messages; not shown with --quiet."""
        self._timing = Console(stderr=True, quiet=not verbose)

    def written(self, text: str) -> None:
        """Print where results were written."""
        self.results.print(text, highlight=False, markup=False, soft_wrap=True)

    def line(self, text: str) -> None:
        """Print a message."""
        self.news.print(text, highlight=False, markup=False, soft_wrap=True)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the duration of a block, and print it to stderr with --verbose."""
        start_s = time.perf_counter()
        yield
        seconds = time.perf_counter() - start_s
        self._timing.print(f"{name}: {seconds:.2f} s", highlight=False, markup=False, soft_wrap=True)

    def progress(self, *more: ProgressColumn, transient: bool = True) -> Progress:
        """Return a progress bar, a context manager; a transient one is removed when it is full."""
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        return Progress(*columns, *more, console=self.news, transient=transient)
