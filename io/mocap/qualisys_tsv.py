"""Qualisys Track Manager's TSV of 3D data: tab-separated rows of a word and its values, then the positions in mm.

The word MARKER_NAMES comes last but for TRAJECTORY_TYPES and a header. The columns Frame and Time, that header, and the
text in place of a hidden marker are options of the export.
"""

from pathlib import Path

from ...models.values.errors import InputError
from ...models.values.tracks import MarkerTracks
from .marker_rows import METRES, MarkerColumns, MarkerRows, positive_number, read_cells

FIRST_CELLS_OF_QUALISYS = ("NO_OF_FRAMES", "FILE_VERSION")
"""Words with which a file begins: of version 2 the second one, with which its files of other data begin, too."""
BELOW_THE_NAMES = ("TRAJECTORY_TYPES", "Frame")
"""Words with which the rows between the names of the markers and the positions begin."""
HIDDEN = ("NULL", "NA")
"""Texts that stand in place of a hidden marker, as blanks, zeros and NaN do."""


def read_qualisys_tsv(path: Path) -> MarkerTracks:
    """Return the markers of a TSV file of Qualisys; times are those of its column, or count from zero at its rate.

    Raises:
        InputError: for a file that cannot be read or is no such file, see `MarkerRows.tracks`.
    """
    rows = read_cells(path, "\t")
    last = next((index for index, row in enumerate(rows) if row[:1] == ["MARKER_NAMES"]), None)
    if last is None:
        raise InputError(f"{path}: no row: expected one that begins with MARKER_NAMES, as of 3D data")
    names = [name for name in rows[last][1:] if name]
    about = {row[0]: row[1] for row in rows[:last] if len(row) > 1}
    if about.get("NO_OF_MARKERS") != str(len(names)):
        expected = f"expected {len(names)} as in row {last + 1}"
        raise InputError(f"{path}: NO_OF_MARKERS: {expected}, got {about.get('NO_OF_MARKERS')}")
    heads = {*BELOW_THE_NAMES, *(f"{name} X" for name in names[:1])}
    first = last + 1
    while first < len(rows) and (len(rows[first]) < 2 or rows[first][0] in heads):
        first += 1
    body = [
        ["" if cell in HIDDEN else cell for cell in row]
        for row in rows[first:]
        if len(row) > 1  # one of blanks is a frame in which all were hidden
    ]
    stamps = 2 if body and len(body[0]) >= 2 + 3 * len(names) else 0
    markers = [
        MarkerColumns(name, (column, column + 1, column + 2))
        for column, name in zip(range(stamps, stamps + 3 * len(names), 3), names, strict=True)
    ]
    table = MarkerRows(path, body, first + 1, stamps + 3 * len(names), markers, METRES["mm"])
    if stamps:  # a rate is not needed: it is EXT where another device triggers the cameras
        return table.tracks(1)
    rate_hz = positive_number(about.get("FREQUENCY", ""), f"{path}: FREQUENCY in Hz")
    return table.tracks(None, 1 / rate_hz)
