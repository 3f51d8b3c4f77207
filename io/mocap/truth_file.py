"""A file of the truth: which format it is, and what it holds."""

from pathlib import Path

from ...models.values.errors import InputError, reason_of
from ...models.values.tracks import MarkerTracks, StampedPositions
from ..input_files import check_regular
from ..positions import read_positions
from .c3d_file import read_c3d
from .marker_rows import check_frames
from .motive_csv import FIRST_CELL, read_motive_csv
from .qualisys_tsv import FIRST_CELLS_OF_QUALISYS, read_qualisys_tsv
from .trc import FIRST_CELL_OF_TRC, read_trc
from .vicon_csv import is_vicon, read_vicon_csv

HEAD_BYTES = 2000
"""Beginning of a file in which its format shows."""


def read_truth(path: Path, node_count: int) -> StampedPositions | MarkerTracks:
    """Return node positions on the host's clock, or markers where a file is of motion capture.

    Raises:
        InputError: for a file that cannot be read, see the readers of the formats.
    """
    head = _head(path)
    if path.suffix.lower() == ".c3d":
        return read_c3d(path)
    if path.suffix.lower() == ".trc" or head.startswith(FIRST_CELL_OF_TRC):
        return read_trc(path)
    if head.startswith(FIRST_CELL):
        return read_motive_csv(path)
    if is_vicon(head):
        return read_vicon_csv(path)
    if head.startswith(FIRST_CELLS_OF_QUALISYS):
        return read_qualisys_tsv(path)
    positions = read_positions(path, node_count)
    check_frames(path, positions.t_s)
    return positions


def _head(path: Path) -> str:
    check_regular(path)
    try:
        with path.open("rb") as file:
            return file.read(HEAD_BYTES).decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason_of(error)}") from error
