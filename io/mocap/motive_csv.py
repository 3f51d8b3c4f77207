"""OptiTrack Motive's CSV, format version 1.2x.

Row 1 holds names and values in turn. Below come rows that say of each column its Type, Name, ID, from version 1.25 on
Parent, and whether it is a Rotation or a Position; then `Frame, Time (Seconds), X, Y, Z ...`, and the values. The words
Type and Name stand in the second column, or are missing in older files.
"""

from collections.abc import Sequence
from pathlib import Path

from ...models.values.errors import InputError
from ...models.values.tracks import MarkerTracks
from .marker_rows import MarkerColumns, MarkerRows, coordinate_columns, metres_per, read_cells

FIRST_CELL = "Format Version"
MEASURED = "Marker"
KINDS = (MEASURED, "Rigid Body Marker", "Bone Marker", "Rigid Body")
"""Types that are read. Of markers of one name the measured one counts, not the one that a rigid body expects."""
TIME = "Time (Seconds)"


def read_motive_csv(path: Path) -> MarkerTracks:
    """Return the markers, and the pivots of rigid bodies, of a Motive CSV file.

    Raises:
        InputError: for a file that cannot be read or is no such file, see `MarkerRows.tracks`.
    """
    rows = read_cells(path, ",")
    about = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    version = about.get(FIRST_CELL, "")
    if not version.startswith("1.2"):
        raise InputError(f"{path}: row 1: {FIRST_CELL}: expected 1.2x, got '{version}'")
    if about.get("Coordinate Space", "Global") != "Global":
        raise InputError(f"{path}: row 1: Coordinate Space: expected Global, got '{about['Coordinate Space']}'")
    metres = metres_per(about.get("Length Units", ""), f"{path}: row 1: Length Units")
    head = next((index for index, row in enumerate(rows) if row[:1] == ["Frame"]), None)
    if head is None or TIME not in rows[head]:
        place = "no row" if head is None else f"row {head + 1}"
        raise InputError(f"{path}: {place}: expected one that begins with Frame, {TIME}")
    markers = _markers(rows[1:head], rows[head], f"{path}: row {head + 1}")
    body = rows[head + 1 :]
    while body and not any(body[-1]):
        body.pop()
    return MarkerRows(path, body, head + 2, len(rows[head]), markers, metres).tracks(rows[head].index(TIME))


def _markers(above: Sequence[Sequence[str]], axes: Sequence[str], where: str) -> list[MarkerColumns]:
    """Return the columns of each marker, from the rows above that of the axes."""
    kind_row = next((index for index, row in enumerate(above) if set(row) & set(KINDS)), None)
    quantity_row = next((row for row in above if "Position" in row), None)
    if kind_row is None or quantity_row is None or kind_row + 1 >= len(above):
        raise InputError(f"{where}: expected rows of Type, Name and Position above it")
    width = len(axes)
    kinds, names, quantities = (_padded(row, width) for row in (above[kind_row], above[kind_row + 1], quantity_row))
    markers = [
        marker
        for marker in coordinate_columns(axes, names)
        if quantities[marker.xyz[0]] == "Position" and kinds[marker.xyz[0]] in KINDS
    ]
    measured = {marker.name for marker in markers if kinds[marker.xyz[0]] == MEASURED}
    return [marker for marker in markers if kinds[marker.xyz[0]] == MEASURED or marker.name not in measured]


def _padded(row: Sequence[str], width: int) -> list[str]:
    return [*row, *[""] * (width - len(row))]
