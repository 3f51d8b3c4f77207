"""Shapes are shown in a process of their own, so that no display can delay the estimate."""

import multiprocessing
import os
import queue
import signal
from collections.abc import Callable, Iterator
from multiprocessing.queues import Queue
from typing import Any, Self

from ...models.structure.shape import Shape


class ShapeProcess:
    """A process that shows shapes; a context manager that ends it.

    A shape that comes while as many as `waiting` have not been fetched is not shown.
    """

    def __init__(self, show: Callable[..., None], *arguments: Any, waiting: int = 1) -> None:
        """Start the process.

        Args:
            show: function of a module, which runs in the process until it returns: its first argument is a queue for
                `arrived_shapes`.
            arguments: its further arguments.
            waiting: largest number of shapes that wait to be fetched.
        """
        context = multiprocessing.get_context("spawn")
        self._queue: Queue[Shape] = context.Queue(maxsize=waiting)
        self._process = context.Process(target=_run, args=(show, self._queue, arguments), daemon=True)
        self._process.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._queue.cancel_join_thread()  # what nobody fetches any more must not hold up the end
        self._process.terminate()
        self._process.join()

    def add(self, shape: Shape) -> None:
        """Show a shape, unless the process still shows earlier ones, or has ended."""
        if self._process.is_alive() and not self._queue.full():
            self._queue.put(shape)


def arrived_shapes(shapes: "Queue[Shape]", every_s: float) -> Iterator[list[Shape]]:
    """Yield the shapes that have arrived, at most so many seconds after the first of them, until the sender has ended.

    Args:
        shapes: the queue that `ShapeProcess` gives.
        every_s: longest time to wait; the list is empty if none has come.
    """
    parent = multiprocessing.parent_process()
    while parent is None or parent.is_alive():
        arrived: list[Shape] = []
        try:
            arrived.append(shapes.get(timeout=every_s))
            while True:
                arrived.append(shapes.get_nowait())
        except queue.Empty:
            yield arrived


def _run(show: Callable[..., None], shapes: "Queue[Shape]", arguments: tuple[Any, ...]) -> None:
    """Show shapes at a low priority, whatever is typed at the terminal."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(10)  # drawing must not delay the estimator
    show(shapes, *arguments)
