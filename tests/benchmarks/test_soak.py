"""The soak: no row lost, memory flat, and the cause of each late shape by hand."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

import soak
import undrawn_command
from pty_board import PtyBoard

COLUMNS = [(name, float) for name in ("t_s", "latency_s", *soak.STAGES, "processor_s", "other_threads_s")]


@pytest.mark.long
def test_ten_minutes(tmp_path, firmware) -> None:
    """TENSEGRAPH_MINUTES sets another duration."""
    minutes = float(os.environ.get("TENSEGRAPH_MINUTES", "10"))
    report = "\n".join(soak.soak(tmp_path, firmware, minutes))
    print(report)
    check(report, minutes)


class LoggingBoard(PtyBoard):
    """A board at rest by its bytes alone, with the log of an emulated one, which takes half of a core."""

    def __init__(self, _firmware: Path, number: int, trial: Path, folder: Path, *_: float, rests: int) -> None:
        super().__init__(folder / f"board{number}", number)
        self.log = folder / f"board{number}.log"
        first = (trial / f"board{number}.csv").read_text().splitlines()[1]
        self._codes = tuple(map(int, first.split(",")[3:]))

    def codes(self) -> tuple[int, ...]:
        return self._codes

    def unplug(self) -> None:
        super().unplug()
        np.savetxt(self.log, [seq for _, seq in self.sent], fmt="%d")


def test_some_seconds(tmp_path, monkeypatch) -> None:
    """Without emulated boards, and without drawing, which `test_ten_minutes` has."""
    monkeypatch.setattr(soak, "COMMAND", (sys.executable, undrawn_command.__file__))
    monkeypatch.setattr(soak, "EmulatedBoard", LoggingBoard)
    report = "\n".join(soak.soak(tmp_path, tmp_path, 0.05))
    check(report, 0.05)


def check(report: str, minutes: float) -> None:
    """Check the tables of rows, and of memory and files."""
    tables = [
        [[cell.strip() for cell in line.split("|")[1:-1]] for line in part.splitlines()[2:]]
        for part in report.split("\n\n")
    ]
    assert [row[0] for row in tables[0]] == [f"{c}, board {b}" for c in ("live --record", "record") for b in (0, 1)]
    for _, sent, recorded, lost in tables[0]:
        assert sent == recorded
        assert int(recorded) > 0.5 * 50 * 60 * minutes  # however busy the machine is
        assert lost == "0"
    for _, begin_mb, end_mb, begin_files, end_files in tables[1] if minutes > 2 else ():
        assert float(end_mb) - float(begin_mb) < 60
        assert end_files == begin_files


def test_rows_that_are_lost_are_counted() -> None:
    """By hand: of the rows 65534 to 65538, 65536 is missing; the one before the recording is not."""
    sent = soak.unwrapped(np.array([*range(65530, 65536), 0, 1, 2]))
    assert sent[-3:].tolist() == [65536, 65537, 65538]
    assert soak.lost_rows(sent, np.array([65534, 65535, 65537, 65538])) == 1


def test_the_part_that_took_most_is_named() -> None:
    """By hand: one shape of three is late, 20 ms of which nobody of this command worked."""
    in_time = (0.00, 0.008, 0, 0.001, 0.002, 0.005, 0.007, 0)
    late = (0.04, 0.030, 0, 0.002, 0.003, 0.025, 0.007, 0.001)
    times = np.array([in_time, in_time, late], COLUMNS)
    lines = list(soak.excess_table(times))
    assert lines[0] == "| 1 of 3 shapes later than 15 ms | shapes | worst, ms |"
    assert lines[2:] == ["| processor taken by other programs | 1 | 30.0 |"]
    assert sum(part[2] for part in soak.causes(times).values()) == pytest.approx(0.030)
