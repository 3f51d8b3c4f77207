"""The writer of trial directories: trial.toml first, then a row per reading, CSV lines ending as RFC 4180 has it."""

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TextIO

import numpy as np
import tomlkit
from numpy.typing import NDArray

from ..models.errors import InputError
from ..models.readings import BoardReading
from .positions import force_columns, position_columns

COMMENTS = {
    "structure.natural_length_m": "L0 of each tendon, unstretched",
    "mechanics.tendon_stiffness_n_per_m": "nominal: tendons differ",
    "rest.seconds": "the structure stands unloaded at its rest shape this long at the start",
    "rest.node_position_m": "optional: that shape, measured once",
    "adc.sensor_side": "ground: V = supply * R / (R + known); supply: V = supply * known / (R + known)",
    "sensors.natural_resistance_ohm": "R0 at L0, measured before mounting",
    "truth.file": "host clock; evaluation only, never an input to the estimator",
}
"""What trial.toml says beside its keys."""


class Recorder:
    """Writes one trial directory; a context manager, whose end closes the files.

    Args:
        path: of the directory, which must not exist yet: a recording is never written over.
        metadata: trial.toml as a mapping, with a `board` table for each file of rows.

    Raises:
        InputError: when `path` exists or can not be written.
    """

    def __init__(self, path: Path, metadata: Mapping[str, Any]) -> None:
        check_trial_path(path)
        self._path, self._metadata = path, metadata
        self._files = ExitStack()
        try:
            path.mkdir(parents=True)
            (path / "trial.toml").write_text(_commented(metadata), encoding="utf-8", newline="\n")
            self._boards = [self._board(table) for table in metadata.get("board", ())]
        except OSError as error:
            self._files.close()
            raise InputError(f"{path}: can not be written: {error}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._files.close()

    def add(self, reading: BoardReading) -> None:
        """Append one row to its board's file."""
        counts = ",".join(map(str, reading.counts))
        self._boards[reading.board].write(f"{reading.host_s:.6f},{reading.seq},{reading.device_us},{counts}\n")

    def add_truth(
        self, t_s: NDArray[np.float64], node_position_m: NDArray[np.float64], load_n: NDArray[np.float64]
    ) -> None:
        """Write the files that `[truth]` names.

        Args:
            t_s: (rows,) host clock.
            node_position_m: (rows, nodes, 3) where the nodes are.
            load_n: (rows, nodes, 3) external force at each.
        """
        count = node_position_m.shape[1]
        tables = {
            "file": (position_columns(count), node_position_m, ".6f"),
            "loads": (force_columns(count), load_n, ".4f"),
        }
        for key, (columns, values, digits) in tables.items():
            file = self._open(self._metadata["truth"][key], ["t_s", *columns])
            for stamp_s, row in zip(t_s, values.reshape(len(t_s), -1), strict=True):
                file.write(f"{stamp_s:.4f}," + ",".join(format(value, digits) for value in row) + "\n")

    def _board(self, table: Mapping[str, Any]) -> TextIO:
        channels = range(len(table["tendon_of_channel"]))
        return self._open(table["file"], ["host_s", "seq", "device_us", *(f"adc{c}" for c in channels)])

    def _open(self, name: str, columns: list[str]) -> TextIO:
        file = self._files.enter_context((self._path / name).open("w", encoding="utf-8", newline="\r\n"))
        file.write(",".join(columns) + "\n")
        return file


def check_trial_path(path: Path) -> None:
    """Refuse to write over anything.

    Raises:
        InputError: when something stands at `path`.
    """
    if path.exists():
        raise InputError(f"{path}: exists: expected a new name for the trial")


def _commented(metadata: Mapping[str, Any]) -> str:
    document = tomlkit.item(dict(metadata))
    for key, comment in COMMENTS.items():
        table, name = key.split(".")
        if name in document.get(table, {}):
            document[table][name].comment(comment)
    return str(document.as_string())
