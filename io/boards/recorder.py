"""Writes trial directories: trial.toml first, then one row per reading, in CSV with the line ends of RFC 4180.

However the process ends, all rows older than one second are on the disk: the directory appears under its name with
trial.toml and the headers in it, each row is passed to the system when it arrives, and `sync` flushes it to the disk.
"""

import os
import queue
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ...models.values.aids import ImuReading, PositionReading, RangeReading
from ...models.values.errors import InputError, RecordingError, TensegraphError
from ...models.values.readings import BoardReading, NaturalLengthReading, RecordedReading
from ...models.values.tracks import StampedPositions
from ..aid_files import AID_COLUMNS, aid_row
from ..positions import contact_columns, force_columns, position_columns
from ..toml import commented
from ..whole import check_vacant, remove_directory, written_whole

COMMENTS = {
    "structure.natural_length_m": "L0 of each tendon, unstretched",
    "mechanics.tendon_stiffness_n_per_m": "nominal: tendons differ",
    "rest.seconds": "the structure stands unloaded at its rest shape this long at the start",
    "rest.node_position_m": "optional: that shape, measured once",
    "adc.sensor_side": "ground: V = supply * R / (R + known); supply: V = supply * known / (R + known)",
    "sensors.natural_resistance_ohm": "R0 at L0, measured before mounting",
    "truth.file": "host clock; evaluation only, never an input to the estimator",
}
"""Comments in trial.toml, by key."""

SYNC_S = 0.5
"""Time between two syncs: a row is on the disk within 1 s, even if a sync takes as long as this time."""


class Recorder:
    """Writes one trial directory; a context manager that closes the files at its end.

    Args:
        path: of the directory, which must not exist yet: a recording is never overwritten.
        metadata: trial.toml as a mapping, with a table for each file: of `board`, `imu`, `range`, `position` or
            `motor`.
        with_boot: whether the boards count how often they started; a column `boot` then says so.

    Raises:
        InputError: when `path` exists or cannot be written.
    """

    def __init__(self, path: Path, metadata: Mapping[str, Any], *, with_boot: bool = False) -> None:
        check_vacant(path)
        self.path = path
        self._metadata = metadata
        self._with_boot = with_boot
        self._files = ExitStack()
        kinds = {kind: metadata.get(kind, ()) for kind in ("board", "imu", "range", "position", "motor")}
        self._motor_of = {e: number for number, motor in enumerate(kinds["motor"]) for e in motor["tendons"]}
        try:
            with written_whole(path) as (inside,):
                inside.mkdir()
                (inside / "trial.toml").write_text(commented(metadata, COMMENTS), encoding="utf-8", newline="\n")
                for kind, tables in kinds.items():
                    for table in tables:
                        file = inside / table["file"]
                        file.parent.mkdir(parents=True, exist_ok=True)
                        file.write_bytes(self._header(kind, table))
            self._opened = {kind: [self._open(table["file"]) for table in tables] for kind, tables in kinds.items()}
        except OSError as error:
            self._files.close()
            remove_directory(path)
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._files.close()

    def add(self, reading: RecordedReading) -> None:
        """Append one row to the file of its board or sensor.

        Raises:
            RecordingError: when it cannot be written; rows before it are kept.
        """
        text = self._board_row(reading) if isinstance(reading, BoardReading) else aid_row(reading)
        row, file = f"{text}\r\n".encode(), self._file_of(reading)
        try:
            while row:  # a disk that is nearly full may write only a part
                row = row[file.write(row) or 0 :]
        except OSError as error:
            raise RecordingError(f"{self.path}: the recording ended: {error.strerror}") from error

    def sync(self) -> None:
        """Flush the rows so far to the disk.

        Raises:
            RecordingError: when they cannot be flushed, or the files were removed.
        """
        try:
            files = [file for opened in self._opened.values() for file in opened]
            for file in files:
                os.fsync(file.fileno())
            if any(os.fstat(file.fileno()).st_nlink == 0 for file in files) or not self.path.is_dir():
                raise RecordingError(f"{self.path}: the recording ended: its files are gone")
        except OSError as error:
            raise RecordingError(f"{self.path}: the recording ended: {error.strerror}") from error

    def add_truth(
        self, truth: StampedPositions, load_n: NDArray[np.float64], standing: NDArray[np.bool_] | None = None
    ) -> None:
        """Write the files that `[truth]` names.

        Args:
            truth: positions of all nodes at all times.
            load_n: (times, nodes, 3) external forces on the nodes.
            standing: (times, nodes) which nodes the floor carries, where `[truth]` names a file of contacts.
        """
        count = truth.node_position_m.shape[1]
        tables = {
            "file": (position_columns(count), truth.node_position_m, ".6f"),
            "loads": (force_columns(count), load_n, ".4f"),
        }
        if standing is not None and "contacts" in self._metadata["truth"]:
            tables["contacts"] = (contact_columns(count), standing.astype(np.float64), ".0f")
        for key, (columns, values, digits) in tables.items():
            with (self.path / self._metadata["truth"][key]).open("w", encoding="utf-8", newline="\r\n") as file:
                file.write(",".join(["t_s", *columns]) + "\n")
                for t_s, row in zip(truth.t_s, values.reshape(len(truth.t_s), -1), strict=True):
                    file.write(f"{t_s:.4f}," + ",".join(format(value, digits) for value in row) + "\n")

    def _open(self, name: str) -> FileIO:
        return self._files.enter_context((self.path / name).open("ab", buffering=0))

    def _file_of(self, reading: RecordedReading) -> FileIO:
        match reading:
            case BoardReading():
                return self._opened["board"][reading.board]
            case ImuReading():
                return self._opened["imu"][reading.imu]
            case RangeReading():
                return self._opened["range"][reading.pair[0]]
            case PositionReading():
                return self._opened["position"][reading.recording]
            case NaturalLengthReading():
                return self._opened["motor"][self._motor_of[reading.tendon]]

    def _board_row(self, reading: BoardReading) -> str:
        counts = ",".join(map(str, reading.counts.tolist()))
        boot = f",{reading.boot}" if self._with_boot else ""
        return f"{reading.host_s:.6f},{reading.seq},{reading.device_us},{counts}{boot}"

    def _header(self, kind: str, table: Mapping[str, Any]) -> bytes:
        columns = AID_COLUMNS.get(kind)
        if columns is None:
            channels = [f"adc{c}" for c in range(len(table["tendon_of_channel"]))]
            columns = ("host_s", "seq", "device_us", *channels, *(["boot"] if self._with_boot else []))
        return f"{','.join(columns)}\r\n".encode()


class RecorderThread:
    """Records in a separate thread, so that a slow disk does not delay the reading of a port; a context manager.

    Rows wait in an unbounded queue so that none is lost; a disk that stalls for a minute costs some megabytes.
    """

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._queue = queue.SimpleQueue[RecordedReading | None]()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.rows = 0
        """Number of rows written so far."""
        self.error = ""
        """Reason why the recording ended early; empty if it did not."""

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._queue.put(None)
        self._thread.join()
        if isinstance(error, TensegraphError) and self.rows == 0:  # refused before anything was recorded
            remove_directory(self._recorder.path)

    def add(self, reading: RecordedReading) -> None:
        """Add a row to the queue; returns immediately."""
        if not self.error:
            self._queue.put(reading)

    def _run(self) -> None:
        with self._recorder:
            try:
                self._write_rows()
            except RecordingError as error:
                self.error = str(error)

    def _write_rows(self) -> None:
        synced_s = time.perf_counter()
        while True:
            try:
                reading = self._queue.get(timeout=0.1)
                if reading is None:
                    break
                self._recorder.add(reading)
                self.rows += 1
            except queue.Empty:
                pass
            if time.perf_counter() - synced_s > SYNC_S:
                self._recorder.sync()
                synced_s = time.perf_counter()
        self._recorder.sync()


def as_recorded(
    reading: RecordedReading,
) -> RecordedReading:
    """Return a reading with the digits that it has in the files of a trial."""
    if isinstance(reading, BoardReading):
        return replace(reading, host_s=round(reading.host_s, 6))
    t_s, *values = map(float, aid_row(reading).split(","))
    match reading:
        case ImuReading():
            rate_rad_per_s, force_m_per_s2 = np.reshape(values, (2, 3))
            return replace(reading, t_s=t_s, rate_rad_per_s=rate_rad_per_s, specific_force_m_per_s2=force_m_per_s2)
        case RangeReading():
            return replace(reading, t_s=t_s, range_m=values[-1])
        case PositionReading():
            return replace(reading, t_s=t_s, position_m=np.array(values[1:]))
        case NaturalLengthReading():
            return replace(reading, t_s=t_s, natural_length_m=values[1], sigma_m=values[2])
