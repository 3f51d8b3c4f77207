"""One thread for small linear algebra: threads that share a matrix of 30 rows cost more time than they save."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

from threadpoolctl import threadpool_limits

_lock = Lock()
_limits: list[threadpool_limits] = []
"""The limit that holds now; one entry for each block that has begun and not ended."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Let numpy's and scipy's linear algebra use one thread in this block.

    Blocks may overlap, like two streams of shapes that are read in turn: the threads that there were before the first
    are back after the last. The digits of a result then do not depend on the number of cores, either.
    """
    with _lock:
        _limits.append(_limits[0] if _limits else threadpool_limits(limits=1, user_api="blas"))
    try:
        yield
    finally:
        with _lock:
            limit = _limits.pop()
            if not _limits:
                limit.restore_original_limits()
