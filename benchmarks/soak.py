"""An hour at the rig, without the rig: `benchmarks/soak.py FOLDER --minutes 60`.

`live --record` reads two boards that run the real firmware in an emulator; at the same time `record` reads two boards
that are known by their bytes alone. All are on ptys, at 50 Hz. It tells how many rows were sent and not recorded, the
memory and the open files of both commands after a minute and at the end, the latency of all shapes by stage, and of the
shapes later than 15 ms in which part they lost the most against its median. What the two commands wrote stays in the
folder, `live/latency.csv` among it.

It needs the packages that .ci/run names, and a quiet machine for figures of latency: each emulated board takes half of
a core. Where other programs run, `chrt -r 5 python benchmarks/soak.py ...` runs it before them.
"""

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from tensegraph import BoardReading, open_trial

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from emulated_board import EmulatedBoard  # noqa: E402
from pty_board import PtyBoard  # noqa: E402

LATE_S = 0.015
"""Latency that 99 % of the shapes should not exceed."""
SETTLED_S = 60.0
"""Time after which memory and open files should not grow."""
STAGES = ("busy_s", "link_s", "lengths_s", "estimate_s")
COMMAND = (sys.executable, "-m", "tensegraph")
"""What is started, before its arguments."""


@dataclass(slots=True)
class Command:
    """A command that runs, and what it and its process for the boards hold: (samples, 3) of s, MB and open files."""

    name: str
    process: subprocess.Popen[bytes]
    held: list[tuple[float, float, int]] = field(default_factory=list)

    @classmethod
    def start(cls, folder: Path, minutes: float, rig: Path, ports: Sequence[Path], *arguments: str) -> "Command":
        """Start `tensegraph` in a folder."""
        words = [*COMMAND, *arguments, "--rig", str(rig), "--seconds", f"{60 * minutes:g}"]
        words += ["--quiet", *(word for port in ports for word in ("--port", str(port)))]
        return cls(arguments[0], subprocess.Popen(words, cwd=folder, stdin=subprocess.DEVNULL))

    def sample(self, t_s: float) -> None:
        """Note memory and open files, unless the command is ending."""
        try:
            processes = [Path(f"/proc/{pid}") for pid in (self.process.pid, *_children(self.process.pid))]
            files = sum(len(list((process / "fd").iterdir())) for process in processes)
            pages = sum(int((process / "statm").read_text().split()[1]) for process in processes)
        except OSError:
            return
        self.held.append((t_s, pages * 4096 / 1e6, files))

    def row(self, seconds: float) -> str:
        """Return a row of the table of memory and files: settled, and at the end, before figures are drawn."""
        running = [held for held in self.held if held[0] <= seconds]
        begin, end = next(held for held in running if held[0] >= min(SETTLED_S, seconds / 2)), running[-1]
        return f"| {self.name} | {begin[1]:.1f} | {end[1]:.1f} | {begin[2]} | {end[2]} |"


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def recorded(trial: Path) -> list[NDArray[np.int64]]:
    """Return the sequence numbers of each board's rows, without the wrap at 16 bits."""
    seqs: dict[int, list[int]] = {0: [], 1: []}
    for row in open_trial(trial).readings():
        if isinstance(row, BoardReading):
            seqs[row.board].append(row.seq)
    return [unwrapped(np.array(seq)) for seq in seqs.values()]


def sent_meanwhile(sent: NDArray[np.int64], received: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return those of the sent rows that are between the first and the last that was recorded."""
    return sent[(sent >= received[0]) & (sent <= received[-1])]


def lost_rows(sent: NDArray[np.int64], received: NDArray[np.int64]) -> int:
    """Return how many rows were sent between the first and the last that was recorded, and are not there."""
    return len(np.setdiff1d(sent_meanwhile(sent, received), received))


def unwrapped(seq: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return sequence numbers of 16 bits, in order, as they would be without an end."""
    return np.cumsum(np.diff(seq, prepend=0) % 2**16)


def latency_table(times: NDArray[np.void]) -> Iterator[str]:
    """Yield the rows of a Markdown table: each stage's quantiles in milliseconds."""
    yield "| ms | median | 99 % | worst |"
    yield "|---|---|---|---|"
    for name in times.dtype.names[1:]:
        median, p99, worst = 1e3 * np.quantile(times[name], (0.5, 0.99, 1.0))
        yield f"| {name.removesuffix('_s').replace('_', ' ')} | {median:.2f} | {p99:.2f} | {worst:.2f} |"


def causes(times: NDArray[np.void]) -> dict[str, NDArray[np.float64]]:
    """Return the parts of each shape's latency by who took the time, which add up to it."""
    within_s = times["lengths_s"] + times["estimate_s"]
    other_s = np.minimum(times["other_threads_s"], np.maximum(within_s - times["processor_s"], 0.0))
    return {
        "busy with the shape before and its output": times["busy_s"],
        "row on its way between the processes": times["link_s"],
        "own work": times["processor_s"],
        "other threads of the command": other_s,
        "processor taken by other programs": within_s - times["processor_s"] - other_s,
    }


def excess_table(times: NDArray[np.void]) -> Iterator[str]:
    """Yield the rows of a Markdown table: in which part late shapes lost the most against that part's median."""
    parts = causes(times)
    late = times["latency_s"] > LATE_S
    yield f"| {late.sum()} of {len(times)} shapes later than {1e3 * LATE_S:g} ms | shapes | worst, ms |"
    yield "|---|---|---|"
    excess_s = np.stack([part - np.median(part) for part in parts.values()], axis=1)[late]
    most = excess_s.argmax(axis=1) if late.any() else np.empty(0)
    for k, name in enumerate(parts):
        if (most == k).any():
            worst_ms = 1e3 * times["latency_s"][late][most == k].max()
            yield f"| {name} | {(most == k).sum()} | {worst_ms:.1f} |"


def soak(folder: Path, firmware: Path, minutes: float) -> Iterator[str]:
    """Run both commands, and yield the lines of the report.

    Args:
        folder: an empty folder for what is written.
        firmware: folder with the firmware and the emulator, see tests/emulator/Makefile.
        minutes: duration.

    Raises:
        CalledProcessError: when a command failed.
    """
    trial = ROOT / "examples" / "press_01"
    rig, plain = folder / "rig.toml", folder / "plain.toml"
    rig.write_text((ROOT / "examples" / "rig.toml").read_text(encoding="utf-8"), encoding="utf-8")
    plain.write_text(rig.read_text(encoding="utf-8").replace("seconds = 2.0", "seconds = 0.0"), encoding="utf-8")
    emulated = [EmulatedBoard(firmware, b, trial, folder, ppm, rests=20) for b, ppm in enumerate((0.0, 2000.0))]
    by_bytes = [PtyBoard(folder / f"bytes{b}", b) for b in (0, 1)]
    for board in (*emulated, *by_bytes):
        board.plug()
    try:
        out = ("--record", "recorded", "--out", "live")
        commands = [
            Command.start(folder, minutes, rig, [board.port for board in emulated], "live", *out),
            Command.start(folder, minutes, plain, [board.port for board in by_bytes], "record", "--out", "plain"),
        ]
        watch(commands)
    finally:
        for board in (*emulated, *by_bytes):
            board.unplug()
    sent = [unwrapped(np.loadtxt(board.log, usecols=0).astype(np.int64)) for board in emulated]
    sent += [np.array([seq for _, seq in board.sent]) for board in by_bytes]
    yield "| rows of | sent | recorded | lost |"
    yield "|---|---|---|---|"
    received = [*recorded(folder / "recorded"), *recorded(folder / "plain")]
    names = [f"{command}, board {b}" for command in ("live --record", "record") for b in (0, 1)]
    for name, board_sent, rows in zip(names, sent, received, strict=True):
        yield f"| {name} | {len(sent_meanwhile(board_sent, rows))} | {len(rows)} | {lost_rows(board_sent, rows)} |"
    yield ""
    yield "| | MB after a minute | at the end | open files after a minute | at the end |"
    yield "|---|---|---|---|---|"
    for command in commands:
        yield command.row(60 * minutes)
    yield ""
    file = folder / "live" / "latency.csv"
    if not file.exists():
        yield "All shapes waited for the taring or for the end."
        return
    times = np.atleast_1d(np.genfromtxt(file, delimiter=",", names=True))
    yield from latency_table(times)
    yield ""
    yield from excess_table(times)


def watch(commands: Sequence[Command]) -> None:
    """Sample what the commands hold until all have ended.

    Raises:
        CalledProcessError: when one failed.
    """
    began_s = time.monotonic()
    while any(command.process.poll() is None for command in commands):
        for command in commands:
            command.sample(time.monotonic() - began_s)
        time.sleep(1.0)
    for command in commands:
        if command.process.returncode:
            raise subprocess.CalledProcessError(command.process.returncode, command.name)


def built(folder: Path) -> Path:
    """Build firmware and emulator in a folder, and return it."""
    subprocess.run(["make", "-s", "-C", str(ROOT / "tests" / "emulator"), f"OUT={folder}"], check=True)
    return folder


def main(
    folder: Annotated[Path, typer.Argument(help="New folder for what is written.")],
    minutes: Annotated[float, typer.Option(min=0.05, help="Duration.")] = 60.0,
) -> None:
    """Print the report."""
    folder.mkdir(parents=True)
    for line in soak(folder.resolve(), built(folder.resolve() / "firmware"), minutes):
        typer.echo(line)


if __name__ == "__main__":
    typer.run(main)
