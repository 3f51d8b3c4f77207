"""Factors that other packages bring: `[[factor]]` of trial.toml, and the check of what they return.

A package names its factor by an entry point of the group `tensegraph.factors`: a class or a function of the table and
the structure, which makes something with the method `rows` of `NodeFactor`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from .plug_ins import PlugIn, errors_of_plug_in, plug_ins
from .structure.rigidity import motions_left
from .structure.structure import Structure
from .values.errors import InputError
from .values.readings import FactorRows, NodeFactor
from .values.tables import FileName, parse_table, unknown_keys

T = TypeVar("T")
ROUNDING = 1e-6
"""Share of a row's derivative along a rigid motion, below which it is zero but for rounding."""


@dataclass(frozen=True, slots=True)
class FactorKeys:
    """The keys of every `[[factor]]`; those beside them are the factor's own."""

    name: str
    file: FileName | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FactorTable:
    """One `[[factor]]` of trial.toml, as a factor gets it."""

    keys: Mapping[str, Any]
    """All of its keys."""
    place: Path
    """Directory of trial.toml, in which the factor's file is."""
    where: str
    """Path of trial.toml and number of the table, for the text of errors."""

    def parsed(self, kind: type[T]) -> T:
        """Return the keys as a dataclass, which has fields for all of them.

        Raises:
            InputError: for a key that is missing, unknown, or has another value than it may have.
        """
        if unknown := list(unknown_keys(kind, self.keys)):
            known = ", ".join(get_type_hints(kind))
            raise InputError(f"{self.where}: {unknown[0].name}: expected one of the keys {known}")
        return parse_table(kind, self.keys, self.where)

    def plug_in(self) -> PlugIn:
        """Return the part of another package that the table names.

        Raises:
            InputError: when there is none, or two packages bring one.
        """
        found, name = plug_ins("factors", ()), self.keys["name"]
        if name not in found:
            known = (
                f"one of {', '.join(found)}" if found else "a factor of an installed package, of which there is none"
            )
            raise InputError(f"{self.where}: name: expected {known}, got '{name}'")
        return found[name]

    def factor(self, structure: Structure) -> "OwnFactor":
        """Return the factor.

        Raises:
            InputError: when it cannot be made.
        """
        plug_in = self.plug_in()
        make: Callable[[FactorTable, Structure], NodeFactor] = plug_in.load()
        with errors_of_plug_in(lambda: f"{self.where}: {plug_in} cannot be made"):
            return OwnFactor(plug_in, self.where, make(self, structure), structure)


@dataclass(frozen=True, slots=True, eq=False)
class OwnFactor:
    """A factor that another package brings; what it returns is checked."""

    plug_in: PlugIn
    where: str
    """See `FactorTable`."""
    part: NodeFactor
    structure: Structure

    def rows(self, t_s: NDArray[np.float64], node_position_m: NDArray[np.float64]) -> FactorRows:
        """Return the rows of the factor, see `NodeFactor`.

        Raises:
            InputError: when it fails, or returns something else than rows of one form, or a row that was read without
                its derivative.
        """
        with errors_of_plug_in(lambda: f"{self.where}: {self.plug_in}"):
            told = self.part.rows(t_s, node_position_m)
            arrays = (np.asarray(each, dtype=np.float64) for each in (told.residual, told.jacobian, told.sigma))
            rows = FactorRows(*arrays)
        lead, count = node_position_m.shape[:-2], rows.residual.shape[-1:]
        expected = ((*lead, *count), (*lead, *count, 3 * self.structure.node_count), (*lead, *count))
        got = (rows.residual.shape, rows.jacobian.shape, rows.sigma.shape)
        if not count or got != expected:
            raise InputError(
                f"{self.where}: {self.plug_in}: expected residual (frames, rows), jacobian (frames, rows, 3 nodes) and "
                f"sigma (frames, rows) of {lead} frames, got arrays of {got}"
            )
        if not np.isfinite(rows.jacobian[np.isfinite(rows.residual) & np.isfinite(rows.sigma)]).all():
            raise InputError(f"{self.where}: {self.plug_in}: expected a finite jacobian of each row that was read")
        if (rows.sigma <= 0).any():
            raise InputError(f"{self.where}: {self.plug_in}: expected sigmas above 0, got {np.nanmin(rows.sigma):g}")
        self._check_needs_no_base(node_position_m, rows)
        return rows

    def _check_needs_no_base(self, node_position_m: NDArray[np.float64], rows: FactorRows) -> None:
        """Raise InputError for rows that tell where a structure is that anchors do not hold.

        Its shape is estimated in a frame of its own, in which nothing of the world can be said.
        """
        if self.structure.is_held:
            return
        along = rows.jacobian @ motions_left(self.structure, node_position_m)
        if np.abs(along).max(initial=0) > ROUNDING * np.abs(rows.jacobian).max(initial=0):
            raise InputError(
                f"{self.where}: {self.plug_in}: expected a factor that depends on the shape alone, for a structure "
                "that fewer than three anchors hold, got one that changes as the structure moves as a whole"
            )

    def __str__(self) -> str:
        return f"{self.where.rpartition(': ')[2]} {self.plug_in.entry.name}"
