"""The tables of a run as Parquet, with the unit and the meaning of each column in its metadata."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ...models.structure.labelled import columns_of
from ...models.values.errors import needs_extra


def write_parquet(arrays: Mapping[str, NDArray[Any]], table: str, about: Mapping[str, Any], path: Path) -> None:
    """Write one table; attributes of the run and the structure are in the metadata of its schema.

    Args:
        arrays: the quantities by name, see `QUANTITIES`.
        table: see `columns_of`.
        about: attributes of the run.
        path: of the file.

    Raises:
        InputError: when pyarrow is not installed.
    """
    with needs_extra("Parquet", "tables"):
        import pyarrow
        import pyarrow.parquet
    columns = columns_of(arrays, table)
    values = [pyarrow.array(column.values) for column in columns]
    values = [value.dictionary_encode() if pyarrow.types.is_string(value.type) else value for value in values]
    fields = [
        pyarrow.field(column.name, value.type, metadata={"unit": column.unit, "meaning": column.meaning})
        for column, value in zip(columns, values, strict=True)
    ]
    structure = {name: arrays[name].tolist() for name in ("rods", "rod_length_m", "tendons", "natural_length_m")}
    metadata = {"tensegraph": json.dumps({**about, **structure, "is_anchor": arrays["is_anchor"].tolist()})}
    schema = pyarrow.schema(fields, metadata=metadata)
    pyarrow.parquet.write_table(pyarrow.Table.from_arrays(values, schema=schema), path, compression="zstd")
