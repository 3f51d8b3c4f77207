"""Vicon Nexus's CSV, or its text with tabs: its section Trajectories.

Below that word come the rate in Hz, the names of the markers over their first columns, `Frame, Sub Frame, X, Y, Z ...`,
the units, and the values up to a blank line or the end. Other sections may stand before and behind.
"""

from pathlib import Path

from ...models.values.errors import InputError
from ...models.values.tracks import MarkerTracks
from .marker_rows import MarkerRows, coordinate_columns, metres_per, positive_number, read_cells

SECTION = "Trajectories"
SECTIONS = ("trajectories", "devices", "events", "joints", "segments", "model outputs")
"""Words with which a file may begin, in lower case."""


def is_vicon(head: str) -> bool:
    """Return whether a file that begins like this is one of Vicon Nexus."""
    first_line = head.lstrip(" ,\t\r\n").partition("\n")[0]
    return first_line.replace("\t", ",").partition(",")[0].strip().lower() in SECTIONS


def read_vicon_csv(path: Path) -> MarkerTracks:
    """Return the markers of a Vicon CSV file; time is zero in frame 1.

    Raises:
        InputError: for a file that cannot be read or is no such file, see `MarkerRows.tracks`.
    """
    rows = read_cells(path, ",")
    if any(row and row[0].startswith("Frame\tSub Frame") for row in rows):
        rows = read_cells(path, "\t")
    head = next((index for index, row in enumerate(rows) if row[:1] == [SECTION]), None)
    if head is None or len(rows) < head + 5:
        raise InputError(f"{path}: expected a section {SECTION} with rate, names, axes and units")
    (rate, *_), names, axes, units = (row or [""] for row in rows[head + 1 : head + 5])
    rate_hz = positive_number(rate, f"{path}: row {head + 2}: rate in Hz")
    if axes[:2] != ["Frame", "Sub Frame"]:
        raise InputError(f"{path}: row {head + 4}: expected Frame, Sub Frame, got {', '.join(axes[:2])}")
    markers = coordinate_columns(axes, names)
    unit = units[markers[0].xyz[0]] if markers and markers[0].xyz[0] < len(units) else ""
    metres = metres_per(unit, f"{path}: row {head + 5}: units")
    body = rows[head + 5 :]
    end = next((index for index, row in enumerate(body) if not any(row)), len(body))
    return MarkerRows(path, body[:end], head + 6, len(axes), markers, metres).tracks(0, 1 / rate_hz, first=1.0)
