"""TRC, the marker file of OpenSim and of Motion Analysis: tab-separated, with names and axes in rows 4 and 5."""

from pathlib import Path

from ...models.values.errors import InputError
from ...models.values.tracks import MarkerTracks
from .marker_rows import MarkerColumns, MarkerRows, metres_per, read_cells

FIRST_CELL_OF_TRC = "PathFileType"


def read_trc(path: Path) -> MarkerTracks:
    """Return the markers of a TRC file.

    Raises:
        InputError: for a file that cannot be read or is no such file, see `MarkerRows.tracks`.
    """
    rows = read_cells(path, "\t")
    if rows and len(rows[0]) == 1 and rows[0][0].startswith(FIRST_CELL_OF_TRC):
        raise InputError(f"{path}: row 1: expected tabs between cells, got '{rows[0][0]:.40}'")
    if len(rows) < 5 or rows[0][:1] != [FIRST_CELL_OF_TRC]:
        raise InputError(f"{path}: row 1: expected {FIRST_CELL_OF_TRC}, and five rows of header")
    about = dict(zip(rows[1], rows[2], strict=False))
    metres = metres_per(about.get("Units", ""), f"{path}: row 3: Units")
    if rows[3][:2] != ["Frame#", "Time"]:
        raise InputError(f"{path}: row 4: expected Frame#, Time, got {', '.join(rows[3][:2])}")
    names = [(column, name) for column, name in enumerate(rows[3]) if column >= 2 and name]
    for place, (column, name) in enumerate(names):
        if column != 2 + 3 * place:
            raise InputError(f"{path}: row 4, column {column + 1}: expected '{name}' in column {3 + 3 * place}")
    if about.get("NumMarkers") != str(len(names)):
        raise InputError(f"{path}: row 3: NumMarkers: expected {len(names)} as in row 4, got {about.get('NumMarkers')}")
    markers = [MarkerColumns(name, (column, column + 1, column + 2)) for column, name in names]
    first = next((index for index in range(5, len(rows)) if any(rows[index])), len(rows))
    body = [row for row in rows[first:] if any(row)]
    return MarkerRows(path, body, first + 1, 2 + 3 * len(names), markers, metres).tracks(1)
