"""The output of commands on the screen, according to --quiet and --verbose."""

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import IO, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn

from ...models.values.errors import TensegraphError, printable
from .progress import StageBar, TimeLeft


class Terminal:
    """The screen, with output at three levels; errors are printed by `cli.main`.

    Raises:
        TensegraphError: when both quiet and verbose are true.
    """

    def __init__(self, *, quiet: bool = False, verbose: bool = False) -> None:
        if quiet and verbose:
            raise TensegraphError("--quiet and --verbose: expected one of them, got both")
        self.results = Console(markup=False)
        """Console for requested output and for paths of written files; always shown."""
        self.news = Console(quiet=quiet, markup=False)
        """Console for tables, progress and messages; not shown with --quiet."""
        self.questions = Console(stderr=True, markup=False)
        """Console for questions: shown also where what the command prints goes into a file."""
        self._timing = Console(stderr=True, quiet=not verbose, markup=False)
        self._shown: Progress | None = None

    def outlive_the_screen(self) -> None:
        """From now on go on when the screen is gone: a terminal that was closed, a pipe whose reader has ended."""
        for console in (self.results, self.news, self._timing):
            console.file = _Screen(console.file)  # type: ignore[assignment]

    def written(self, text: str) -> None:
        """Print where results were written."""
        self.results.print(printable(text), highlight=False, soft_wrap=True)

    def line(self, text: str) -> None:
        """Print a message."""
        self.news.print(printable(text), highlight=False, soft_wrap=True)

    def error(self, text: str) -> None:
        """Print on stderr what failed while other work goes on."""
        with suppress(OSError):  # where stderr is on a full disk
            print(f"tensegraph: {printable(text)}", file=sys.stderr)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the duration of a block, and print it to stderr with --verbose."""
        start_s = time.perf_counter()
        yield
        seconds = time.perf_counter() - start_s
        self._timing.print(f"{name}: {seconds:.2f} s", highlight=False, soft_wrap=True)

    @contextmanager
    def progress(self, *more: ProgressColumn) -> Iterator[Progress]:
        """Give a display of progress bars, which goes when the block ends; inside such a block, the same display."""
        if self._shown is not None:
            yield self._shown
            return
        name = TextColumn("{task.description}", markup=False)
        columns = (name, BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TimeLeft())
        try:
            hidden = not self.news.is_terminal
            with Progress(*columns, *more, console=self.news, transient=True, disable=hidden) as self._shown:
                yield self._shown
        finally:
            self._shown = None

    @contextmanager
    def stages(self, name: str, share_of: Mapping[str, float]) -> Iterator[StageBar]:
        """Give a bar over all stages of a piece of work, see `StageBar`."""
        with self.progress() as progress:
            bar = StageBar(progress, name, share_of)
            try:
                yield bar
            finally:
                bar.close()


class _Screen:
    """A stream that may go while it is written to; what is written afterwards goes nowhere."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> None:
        """Write a text."""
        self._or_nowhere(lambda: self._stream.write(text))

    def flush(self) -> None:
        """Pass on what was written."""
        self._or_nowhere(self._stream.flush)

    def _or_nowhere(self, write: Callable[[], object]) -> None:
        try:
            write()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)
