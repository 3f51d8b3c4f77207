"""The quantities of a run with their labels and units: columns of tables, data frames of pandas, datasets of xarray."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError, needs_extra
from .quantities import LABELS, NODES, QUANTITIES, TENDONS, Quantity, in_words

if TYPE_CHECKING:
    import pandas
    import xarray

TABLES = {"frames": ("t_s",), "nodes": NODES, "tendons": TENDONS}
"""What a row of each table is of."""
PREFIXES = {"node": "n", "tendon": "t"}
"""What stands before the number of a node or a tendon, in the names of the columns of a table of frames."""


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A column of a table."""

    name: str
    values: NDArray[Any]
    """(rows,)"""
    unit: str
    meaning: str


def columns_of(arrays: Mapping[str, NDArray[Any]], table: str) -> list[Column]:
    """Return the columns of a table.

    Args:
        arrays: the quantities of a run by name, see `QUANTITIES`.
        table: `nodes` and `tendons` have a row for each frame and node or tendon; `frames` has a row for each frame,
            and columns for each node and tendon.

    Raises:
        InputError: when there is no such table.
    """
    if table not in TABLES:
        raise InputError(f"table '{table}': expected one of {', '.join(TABLES)}")
    rows = TABLES[table]
    columns = list(_numbers(arrays, rows[1])) if len(rows) > 1 else []
    for name, values in arrays.items():
        quantity = QUANTITIES[name]
        if quantity.dimensions[: len(rows)] != rows:
            continue
        if quantity.dimensions[:2] in (NODES, TENDONS) and len(rows) == 1:
            columns += _of_each(name, quantity, values)
        else:
            columns += _components("", name, quantity, values.reshape(-1, *values.shape[len(rows) :]))
    return columns


def _numbers(arrays: Mapping[str, NDArray[Any]], member: str) -> Iterator[Column]:
    """Yield the columns that say of which frame and of which node or tendon a row is."""
    count = len(arrays["is_anchor" if member == "node" else "natural_length_m"])
    t_s = arrays["t_s"]
    yield Column("t_s", np.repeat(t_s, count), "s", QUANTITIES["t_s"].meaning)
    yield Column(member, np.tile(np.arange(count), len(t_s)), "1", f"number of the {member}, from 0")


def _of_each(name: str, quantity: Quantity, values: NDArray[Any]) -> Iterator[Column]:
    """Yield the columns of (rows, members, ...) values, member by member."""
    for member in range(values.shape[1]):
        yield from _components(f"{PREFIXES[quantity.dimensions[1]]}{member}_", name, quantity, values[:, member])


def _components(prefix: str, name: str, quantity: Quantity, values: NDArray[Any]) -> Iterator[Column]:
    """Yield the columns of (rows, ...) values, one for each component that has a name."""
    components = values.reshape(len(values), -1).T
    for component, column in zip(components, quantity.columns or (name,), strict=True):
        if column and quantity.codes:
            words = np.array([in_words(quantity, int(code)) for code in component])
            yield Column(prefix + column, words, "", quantity.meaning)
        elif column:
            yield Column(prefix + column, component, quantity.unit, quantity.meaning)


def as_dataframe(columns: Sequence[Column], attributes: Mapping[str, Any]) -> "pandas.DataFrame":
    """Return a data frame; `attrs` has the attributes, and the unit and the meaning of each column.

    Raises:
        InputError: when pandas is not installed.
    """
    with needs_extra("a data frame", "tables"):
        import pandas
    frame = pandas.DataFrame({column.name: column.values for column in columns})
    frame.attrs = {
        **attributes,
        "units": {column.name: column.unit for column in columns},
        "meanings": {column.name: column.meaning for column in columns},
    }
    return frame


def as_dataset(arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any]) -> "xarray.Dataset":
    """Return a dataset with the attributes; units and meanings of its variables are as the CF conventions have them.

    Raises:
        InputError: when xarray is not installed.
    """
    with needs_extra("a dataset", "tables"):
        import xarray
    variables = {
        name: (QUANTITIES[name].dimensions, values, cf_attributes(QUANTITIES[name])) for name, values in arrays.items()
    }
    dimensions = {name for quantity in map(QUANTITIES.__getitem__, arrays) for name in quantity.dimensions}
    labels = {name: list(labels) for name, labels in LABELS.items() if name in dimensions}
    return xarray.Dataset(variables, labels, dict(attributes))


def cf_attributes(quantity: Quantity) -> dict[str, Any]:
    """Return unit, meaning and codes of a quantity as attributes of a variable."""
    attributes: dict[str, Any] = {"long_name": quantity.meaning}
    if quantity.unit:
        attributes["units"] = quantity.unit
    if quantity.codes:
        numbers = np.array(list(quantity.codes), dtype=np.int64)
        attributes |= {"flag_masks" if quantity.bits else "flag_values": numbers}
        attributes["flag_meanings"] = " ".join(quantity.codes.values())
    return attributes
