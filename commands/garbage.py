"""How often Python looks for garbage while a command computes."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

NEW_OBJECTS = 20_000
"""Number of new objects after which it looks. After each 700, which is usual, a twentieth of the time of a short trial
went into looking through objects that stay: modules, shapes, parts of figures."""


@contextmanager
def rare_collections() -> Iterator[None]:
    """Let Python look for garbage rarely, until the block ends."""
    usual = gc.get_threshold()
    gc.set_threshold(NEW_OBJECTS, *usual[1:])
    try:
        yield
    finally:
        gc.set_threshold(*usual)
