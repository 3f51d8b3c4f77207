"""Boards on real ptys, read in a process of its own, and everything that happens to cables."""

import os
import time
import tty
from threading import Event, Thread

import numpy as np
import pytest

from tensegraph.io.boards.hub import LinkPlan
from tensegraph.io.boards.process import SerialLink
from tensegraph.models.values.errors import TensegraphError


def taken(link: SerialLink, until, timeout_s: float = 20.0) -> list:
    """Return the rows that come until a condition on them holds."""
    rows, until_s = [], time.monotonic() + timeout_s
    for row in link.rows():
        rows.append(row)
        if until(rows):
            return rows
        assert time.monotonic() < until_s, [(r.board, r.boot, r.seq) for r in rows[-5:]]
    return rows


def of(board: int, rows: list) -> list[tuple[int, int]]:
    return [(row.boot, row.seq) for row in rows if row.board == board]


def settled(link: SerialLink, condition, timeout_s: float = 10.0):
    """Return the link's state once a condition on it holds."""
    until_s = time.monotonic() + timeout_s
    while not condition(link.state):
        assert time.monotonic() < until_s, link.state
        time.sleep(0.02)
        link.receive()
    return link.state


def test_swapped_ports_garbage_and_a_cable_that_was_out(tmp_path, pty_boards) -> None:
    """Boards are told by their id; every row comes, once, in one order of arrival; a board comes back by itself."""
    one, zero = pty_boards("a", 1), pty_boards("b", 0)
    plan = LinkPlan((0, 1), (12, 12), (str(one.port), str(zero.port)), 500_000)
    with SerialLink(plan) as link:
        rows = taken(link, lambda rows: len(of(0, rows)) > 25 and len(of(1, rows)) > 25)
        zero.interference.append(b"\x07garbage\x00\x03\x01")
        rows += taken(link, lambda rows: len(of(0, rows)) > 25)
        one.unplug()
        state = settled(link, lambda state: not state.ports[0].connected)
        assert state.ports[0].complaint in ("not there", "the device is gone")
        alone = taken(link, lambda rows: len(of(0, rows)) > 75)
        assert of(1, alone[-50:]) == []
        one.plug()
        rows += alone + taken(link, lambda rows: len(of(1, rows)) > 25)
        state = settled(link, lambda state: state.ports[0].connected)
        sent_by = {0: list(zero.sent), 1: list(one.sent)}
        rows += taken(
            link, lambda rows: len(of(0, rows)) > 25 and len(of(1, rows)) > 25
        )  # and those are not on the way
        link.stop()
        rows += list(link.rows())
        state = link.state
    assert (np.diff([row.host_s for row in rows]) > 0).all()
    for board, boot in ((0, 0), (1, 0), (1, 1)):
        came = [seq for b, seq in of(board, rows) if b == boot]
        missing = {seq for b, seq in sent_by[board] if b == boot and seq >= came[0]} - set(came)
        assert len(came) == len(set(came))
        unplugged = (board, boot) == (1, 0)
        assert all(unplugged and seq > max(came) for seq in missing), missing  # on the wire while the cable went
    assert {boot for boot, _ in of(1, rows)} == {0, 1}
    counts = {port.board: port.counts for port in state.ports}
    assert counts[0].garbage + counts[0].bad_crc >= 1
    assert counts[1].bad_crc == counts[1].garbage == 0
    assert {port.board: port.hello.firmware for port in state.ports} == {0: "pty 1", 1: "pty 1"}


def test_a_stranger_a_double_and_a_wrong_number_of_channels(pty_boards) -> None:
    good, double = pty_boards("good", 0), pty_boards("double", 0)
    stranger, narrow = pty_boards("stranger", 9), pty_boards("narrow", 1, channels=8)
    ports = tuple(str(board.port) for board in (good, double, stranger, narrow))
    with SerialLink(LinkPlan((0, 1), (12, 12), (*ports, ports[0] + "-absent"), 500_000)) as link:
        rows = taken(link, lambda rows: len(rows) > 100)
        state = settled(link, lambda state: sum(bool(port.complaint) for port in state.ports) == 4)
    assert of(1, rows) == []
    assert all(late > early for early, late in zip(of(0, rows), of(0, rows)[1:], strict=False))
    complaints = {port.port: port.complaint for port in state.ports}
    first, second = sorted((ports[0], ports[1]), key=lambda port: bool(complaints[port]))
    assert complaints[second] == f"board 0 is on {first} too: flash one with another BOARD_ID"
    assert complaints[ports[2]] == "board 9 is not in the rig: expected 0, 1"
    assert complaints[ports[3]] == "board 1 sends 8 channels, the rig has 12"
    assert complaints[ports[0] + "-absent"] == "not there"


def test_a_sketch_that_can_no_longer_be_read_is_told() -> None:
    """It counts microseconds in a signed number, which is negative after 36 minutes, until it is reset."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    device_us, ended = [2**31 - 200_000], Event()

    def send() -> None:
        while not ended.wait(0.02):
            device_us[0] += 20_000
            signed_us = (device_us[0] + 2**31) % 2**32 - 2**31
            os.write(ours, b"0,%d,%d,512,513\n" % (device_us[0] // 20_000 % 2**16, signed_us))

    sketch = Thread(target=send, daemon=True)
    with SerialLink(LinkPlan((0,), (2,), (os.ttyname(theirs),), 500_000)) as link:
        link.wait_until_it_reads()
        sketch.start()
        taken(link, lambda rows: len(rows) > 3)
        settled(link, lambda state: state.ports[0].complaint.startswith("sends what cannot be read"))
        device_us[0] = 0
        taken(link, lambda rows: len(rows) > 3)
        settled(link, lambda state: not state.ports[0].complaint)
    ended.set()
    sketch.join()
    os.close(ours)
    os.close(theirs)


def test_any_thread_may_read_boards(pty_boards) -> None:
    """As one of ROS or of Qt; only the main thread may change what signals do."""
    plan = LinkPlan((0,), (12,), (str(pty_boards("a", 0).port),), 500_000)
    rows: list = []

    def read() -> None:
        with SerialLink(plan) as link:
            rows.extend(taken(link, lambda rows: len(rows) > 10))
            link.stop()

    thread = Thread(target=read)
    thread.start()
    thread.join(30)
    assert len(rows) > 10


def test_a_burst_at_ten_times_the_rate_is_read_whole(pty_boards) -> None:
    """For a second one board sends a row each 2 ms; every row of both boards comes, in one order of arrival."""
    fast, calm = pty_boards("a", 0), pty_boards("b", 1)
    with SerialLink(LinkPlan((0, 1), (12, 12), (str(fast.port), str(calm.port)), 500_000)) as link:
        rows = taken(link, lambda rows: len(of(0, rows)) > 10 and len(of(1, rows)) > 10)
        fast.period_s = 0.002
        rows += taken(link, lambda rows: len(of(0, rows)) > 500)
        fast.period_s = 0.02
        rows += taken(link, lambda rows: len(of(0, rows)) > 25 and len(of(1, rows)) > 25)
    assert (np.diff([row.host_s for row in rows]) > 0).all()
    for board in (0, 1):
        assert (np.diff([seq for _, seq in of(board, rows)]) == 1).all()


def test_rows_end_at_a_time_with_and_without_rows(pty_boards) -> None:
    """The first end comes between rows, and no row is lost there; the second comes while the board is silent."""
    board = pty_boards("a", 0)
    with SerialLink(LinkPlan((0,), (12,), (str(board.port),), 500_000)) as link:
        taken(link, lambda rows: len(rows) > 5)
        until_s = time.perf_counter() + 0.3
        early = list(link.rows(until_s))
        rows = early + taken(link, lambda rows: len(rows) > 5)
        board.unplug()
        until_s, last_s = time.perf_counter() + 0.3, until_s
        list(link.rows(until_s))
        ended_s = time.perf_counter()
    assert len(early) > 5
    assert early[-1].host_s <= last_s
    assert (np.diff([row.seq for row in rows]) == 1).all()
    assert until_s < ended_s < until_s + 10.0


def test_what_is_too_old_is_skipped_while_newer_rows_wait(monkeypatch, pty_boards) -> None:
    """A reader that stood still for a second and a half, where half a second is too old, goes on with the newest."""
    monkeypatch.setattr("tensegraph.io.boards.process.OLDEST_S", 0.5)
    board = pty_boards("a", 0)
    with SerialLink(LinkPlan((0,), (12,), (str(board.port),), 500_000)) as link:
        before = taken(link, lambda rows: len(rows) > 5)
        time.sleep(1.5)
        after = taken(link, lambda rows: len(rows) > 25)
        skipped = settled(link, lambda state: True).skipped_rows
    assert after[0].seq - before[-1].seq == skipped + 1
    assert skipped > 25
    assert (np.diff([row.seq for row in after]) == 1).all()


@pytest.mark.long
def test_an_estimator_that_sleeps_skips_and_a_recorder_never(tmp_path, example, pty_boards) -> None:
    """A reader that stands still for 40 s gets the newest rows and a count of the others; the disk has them all."""
    from tensegraph import open_trial

    boards = [pty_boards("a", 0), pty_boards("b", 1)]
    plan = LinkPlan((0, 1), (12, 12), tuple(str(board.port) for board in boards), 500_000)
    with SerialLink(plan) as link:
        taken(link, lambda rows: len(of(0, rows)) > 5 and len(of(1, rows)) > 5)
        link.begin(time.perf_counter(), tmp_path / "trial", open_trial(example).toml)
        time.sleep(60)
        rows = taken(link, lambda rows: time.perf_counter() - rows[-1].host_s < 0.1)
        link.stop()
        rows += list(link.rows())
        state = link.state
    assert state.skipped_rows > 1000
    assert state.recorded_rows >= len(rows) + state.skipped_rows - 20
    for board in (0, 1):
        seqs = [row.seq for row in open_trial(tmp_path / "trial").readings() if row.board == board]
        assert (np.diff(seqs) == 1).all()
        assert len(seqs) > 2900


def test_reading_for_a_recording_ends_with_it_though_the_boards_are_silent(tmp_path, pty_boards) -> None:
    """The trial stands there already, and the cable is out; rows that are wanted for themselves go on."""
    board = pty_boards("a", 0)
    with SerialLink(LinkPlan((0,), (12,), (str(board.port),), 500_000)) as link:
        taken(link, lambda rows: len(rows) > 5)
        board.unplug()
        link.begin(time.perf_counter(), tmp_path)
        assert list(link.rows(time.perf_counter() + 1.0)) == []
        assert "exists: expected a new name" in link.state.recording_error
        board.plug()
        taken(link, lambda rows: len(rows) > 5)
        board.unplug()
        link.begin(time.perf_counter(), tmp_path, only_records=True)
        begun_s = time.monotonic()
        list(link.rows(time.perf_counter() + 60.0))
        assert time.monotonic() - begun_s < 10.0


@pytest.mark.parametrize("end", ["kill", "terminate"])
def test_rows_before_the_process_was_killed_come_and_its_end_is_told(pty_boards, end) -> None:
    """As by a system that is out of memory, or by a termination of it alone.

    What follows the rows, such as the result, is done before the error.
    """
    plan = LinkPlan((0,), (12,), (str(pty_boards("a", 0).port),), 500_000)
    died = pytest.raises(TensegraphError, match=r"^the process that reads the boards ended by itself$")
    with died, SerialLink(plan) as link:
        rows = taken(link, lambda rows: len(rows) > 5)
        getattr(link._process, end)()
        rows += list(link.rows())
        link.stop()
        done = True
    assert done
    assert (np.diff([row.seq for row in rows]) == 1).all()
