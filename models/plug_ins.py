"""Parts that other packages bring: what their entry points name, by kind and name.

A package that brings an estimator has this in its `pyproject.toml`:

    [project.entry-points."tensegraph.estimators"]
    rest-held = "own_parts.estimators:RestHeld"

Nothing of it is imported before its name is used.
"""

import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal

from .values.errors import InputError, TensegraphError

PlugInKind = Literal["estimators", "factors", "sensor_models", "readers", "exporters"]


class PlugInWarning(UserWarning):
    """A plug-in is not used, because its name is taken."""


@dataclass(frozen=True, slots=True)
class PlugIn:
    """A part that another package brings."""

    kind: PlugInKind
    entry: EntryPoint

    @property
    def package(self) -> str:
        """Name of the package that brings it."""
        return self.entry.dist.name if self.entry.dist else self.entry.module

    @property
    def version(self) -> str:
        """Version of this package."""
        return self.entry.dist.version if self.entry.dist else ""

    def load(self) -> Any:
        """Return what the entry point names.

        Raises:
            InputError: when it cannot be imported, for whatever reason, or cannot be called.
        """
        try:
            part = self.entry.load()
        except Exception as error:  # the import runs the code of the package, which may raise anything
            raise InputError(f"{self}: {self.entry.value} cannot be imported: {_reason(error)}") from error
        if not callable(part):
            raise InputError(f"{self}: {self.entry.value}: expected a class or a function, got {type(part).__name__}")
        return part

    def __str__(self) -> str:
        return f"{self.kind[:-1].replace('_', ' ')} '{self.entry.name}' of package {self.package} {self.version}"


def plug_ins(kind: PlugInKind, ours: Collection[str]) -> dict[str, PlugIn]:
    """Return the plug-ins of a kind by name.

    Args:
        kind: of the parts.
        ours: names of the package's own parts of this kind, which no plug-in replaces; a warning names one that would.

    Raises:
        InputError: when two packages bring parts of one name.
    """
    found = [PlugIn(kind, entry) for entry in entry_points(group=f"tensegraph.{kind}")]
    for plug_in in found:
        if plug_in.entry.name in ours:
            _warn(f"{plug_in}: is not used: the name is one of tensegraph's own")
    free = sorted((one for one in found if one.entry.name not in ours), key=lambda one: one.entry.name)
    for name, count in Counter(one.entry.name for one in free).items():
        if count > 1:
            both = " and ".join(sorted(one.package for one in free if one.entry.name == name))
            raise InputError(f"{kind[:-1].replace('_', ' ')} '{name}': expected one package that brings it, got {both}")
    return {one.entry.name: one for one in free}


@contextmanager
def errors_of_plug_in(doing: Callable[[], str]) -> Iterator[None]:
    """Turn whatever the code of another package raises in this block into one line; errors of tensegraph pass.

    Args:
        doing: returns what was done, for the text.

    Raises:
        InputError: with what was done and the reason.
    """
    try:
        yield
    except TensegraphError:
        raise
    except Exception as error:
        raise InputError(f"{doing()}: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    """Return the kind and the text of an error in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


@cache
def _warn(text: str) -> None:
    """Give a warning, once in a process."""
    warnings.warn(text, PlugInWarning, stacklevel=3)
