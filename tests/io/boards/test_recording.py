"""What is on the disk when a recording ends as it should not: killed, with a full disk, without its directory."""

import os
import resource
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from tensegraph import BoardReading, InputError, open_trial
from tensegraph.io.boards.recorder import Recorder, RecorderThread

RECORDS = """
import os, signal, sys, time
from pathlib import Path
import numpy as np
from tensegraph import BoardReading, open_trial
from tensegraph.io.boards.recorder import Recorder, RecorderThread

folder, example, kills = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
metadata = open_trial(example).toml
rng, victims = np.random.default_rng(kills), []
for k in range(kills):
    begin_s = time.perf_counter()
    if (child := os.fork()) == 0:
        with RecorderThread(Recorder(folder / f"trial{k}", metadata, with_boot=True)) as recorder:
            for seq in range(100_000):
                time.sleep(max(begin_s + 0.005 * seq - time.perf_counter(), 0))
                now_s = time.perf_counter()
                for board in (0, 1):
                    row = BoardReading(board, now_s - begin_s, seq % 65536, 5000 * seq, np.arange(12), 0)
                    recorder.add(row)
    victims.append((begin_s + rng.uniform(0, 3), begin_s, k, child))
    if len(victims) == 5 or k == kills - 1:
        for at_s, begin_s, k, child in sorted(victims):
            time.sleep(max(at_s - time.perf_counter(), 0))
            os.kill(child, signal.SIGKILL)
            print(k, time.perf_counter() - begin_s, flush=True)
            os.waitpid(child, 0)
        victims = []
"""
"""Records two rows each 5 ms in a child, kills the child at a random moment; says when. Five at a time."""


def check_kills(tmp_path, example, kills: int) -> None:
    """Every trial opens, and holds every row that is older than a second, without a gap."""
    command = [sys.executable, "-c", RECORDS, str(tmp_path), str(example), str(kills)]
    said = subprocess.run(command, capture_output=True, text=True, timeout=30 + 3 * kills, check=True).stdout
    lines = [line.split() for line in said.splitlines()]
    assert len(lines) == kills
    for name, killed_s in lines:
        path = tmp_path / f"trial{name}"
        if not path.exists():
            assert float(killed_s) < 1
            continue
        rows = list(open_trial(path).readings()) if (path / "board1.csv").read_text().count("\n") > 1 else []
        for board in (0, 1):
            of_board = [row for row in rows if row.board == board]
            assert [row.seq for row in of_board] == list(range(len(of_board)))
            last_s = of_board[-1].host_s if of_board else 0.0
            assert last_s > float(killed_s) - 1.0, (name, killed_s)


def test_killed_at_any_moment_nothing_older_than_a_second_is_lost(tmp_path, example) -> None:
    check_kills(tmp_path, example, 5)


@pytest.mark.long
def test_killed_fifty_times(tmp_path, example) -> None:
    check_kills(tmp_path, example, 50)


def row(seq: int, board: int = 0) -> BoardReading:
    return BoardReading(board, 0.02 * seq, seq, 20_000 * seq, np.full(12, 512), boot=3)


def test_the_boot_counter_comes_back(tmp_path, example) -> None:
    metadata = open_trial(example).toml
    with Recorder(tmp_path / "trial", metadata, with_boot=True) as recorder:
        recorder.add(row(0))
        recorder.add(row(1, board=1))
    assert [(r.board, r.boot, r.seq) for r in open_trial(tmp_path / "trial").readings()] == [(0, 3, 0), (1, 3, 1)]


def test_a_full_disk_ends_the_recording_alone(tmp_path, example) -> None:
    """The system refuses to let the file grow: what was written stays, an error says so, the caller goes on."""
    metadata = open_trial(example).toml
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with RecorderThread(Recorder(tmp_path / "trial", metadata)) as recorder:
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limits[1]))
            for seq in range(200):
                recorder.add(row(seq))
            until_s = time.monotonic() + 5
            while not recorder.error and time.monotonic() < until_s:
                time.sleep(0.01)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        recorder.add(row(200))
    assert recorder.error == f"{tmp_path / 'trial'}: the recording ended: File too large"
    rows = list(open_trial(tmp_path / "trial").readings())
    assert [r.seq for r in rows] == list(range(recorder.rows))
    assert 50 < len(rows) < 100


def test_a_directory_that_vanishes_is_noticed(tmp_path, example) -> None:
    with RecorderThread(Recorder(tmp_path / "trial", open_trial(example).toml)) as recorder:
        recorder.add(row(0))
        time.sleep(0.2)
        shutil.rmtree(tmp_path / "trial")
        recorder.add(row(1))
        until_s = time.monotonic() + 5
        while not recorder.error and time.monotonic() < until_s:
            time.sleep(0.01)
    assert recorder.error.endswith("trial: the recording ended: its files are gone")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written(tmp_path, example) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="cannot be written"):
        Recorder(tmp_path / "trial", open_trial(example).toml)


def test_a_recording_that_is_killed_from_the_shell(tmp_path, example, pty_boards) -> None:
    """`kill -9` of the command: the process that records notices, and ends its files in order."""
    pty_boards("one", 0)
    pty_boards("two", 1)
    rig = tmp_path / "rig.toml"
    rig.write_text((example.parent / "rig.toml").read_text().replace("seconds = 2.0", "seconds = 0.0"))
    command = [sys.executable, "-m", "tensegraph", "record", "--rig", rig, "--out", tmp_path / "trial"]
    command += ["--port", tmp_path / "one", "--port", tmp_path / "two"]
    process = subprocess.Popen(list(map(str, command)), stdout=subprocess.DEVNULL, start_new_session=True)
    until_s = time.monotonic() + 60
    while not (tmp_path / "trial" / "board0.csv").exists() and time.monotonic() < until_s:
        time.sleep(0.05)
    time.sleep(1.0)
    process.send_signal(signal.SIGKILL)
    process.wait()
    time.sleep(1.0)
    rows = list(open_trial(tmp_path / "trial").readings())
    assert len(rows) > 80
    for board in (0, 1):
        seqs = [r.seq for r in rows if r.board == board]
        assert (np.diff(seqs) == 1).all()
    size = (tmp_path / "trial" / "board0.csv").stat().st_size
    time.sleep(0.3)
    assert (tmp_path / "trial" / "board0.csv").stat().st_size == size  # nobody goes on writing


def test_a_session_refused_before_its_first_row_leaves_no_recording(tmp_path, example) -> None:
    """One that is refused later leaves what was recorded."""
    for rows in (0, 1):
        recorder = Recorder(tmp_path / f"rows{rows}", open_trial(example).toml)
        with pytest.raises(InputError, match="too high"), RecorderThread(recorder) as thread:  # noqa: PT012
            for seq in range(rows):
                thread.add(row(seq))
            raise InputError("frames.rate_hz: too high")
    assert [path.name for path in tmp_path.iterdir()] == ["rows1"]
