"""Where the rows of all boards meet, without boards."""

import multiprocessing
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from types import SimpleNamespace

from tensegraph.io.boards.hub import Begin, Hub, LinkPlan
from tensegraph.io.boards.port import PortReader
from tensegraph.io.boards.protocol import Row


class InterruptedDict(dict):
    """A dictionary in which something happens while its items are iterated."""

    def __init__(self, interrupt: Callable[[], None]) -> None:
        super().__init__()
        self.interrupt = interrupt

    def items(self):
        for item in super().items():
            self.interrupt()
            yield item


def test_a_board_may_be_heard_while_the_state_is_reported() -> None:
    """The second board's first row arrives in the middle of a report: both boards are in a later one."""
    plan = LinkPlan((0, 1), (1, 1), ("absent0", "absent1"), 500_000)
    hub = Hub(plan)
    hub.look_for_ports()
    readers = list(hub._readers.values())
    second = threading.Thread(target=take, args=(hub, readers[1], 1), daemon=True)

    def interrupt() -> None:
        if second.ident is None:
            second.start()
            second.join(0.3)  # with the lock it has to wait

    hub._owner = InterruptedDict(interrupt)
    take(hub, readers[0], 0)
    ours, theirs = multiprocessing.Pipe()
    sender = threading.Thread(target=hub.send_all, args=(theirs,), daemon=True)
    sender.start()
    time.sleep(0.5)
    hub.stop_reading()
    hub.finish()
    sender.join(5)
    messages = []
    while ours.poll(0.5) and (message := ours.recv()) is not None:
        messages.append(message)
    assert {port.board for port in messages[-1].ports} == {0, 1}


def take(hub: Hub, reader: PortReader, board: int) -> None:
    hub.take(reader, [Row(board_id=board, boot=0, seq=0, device_us=0, codes=(512,))], time.perf_counter())


def test_a_recording_that_cannot_begin_does_not_end_the_reading(tmp_path, monkeypatch) -> None:
    """Whatever error of the system it is: the state tells it, and rows are still handed on."""

    def refused(*_, **__):
        raise PermissionError(13, "Permission denied", "trial")

    monkeypatch.setattr("tensegraph.io.boards.hub.Recorder", refused)
    hub = Hub(LinkPlan((0,), (1,), ("absent",), 500_000))
    hub.look_for_ports()
    with ExitStack() as recording:
        hub.begin(Begin(0.0, tmp_path / "trial", {}), recording)
        take(hub, next(iter(hub._readers.values())), 0)
    hub.stop_reading()
    assert "Permission denied" in hub._state().recording_error
    assert len(hub._outgoing) == 1


def test_a_device_that_goes_while_ports_are_listed_ends_nothing(monkeypatch) -> None:
    """pyserial takes the number of a device from a file that is gone; the next look finds what is there."""
    listed = iter([lambda: int(None, 16), lambda: [SimpleNamespace(device="absent", description=None, vid=0x2341)]])
    monkeypatch.setattr("tensegraph.io.boards.port.list_ports.comports", lambda: next(listed)())
    hub = Hub(LinkPlan((0,), (1,), (), 500_000))
    hub.look_for_ports()
    assert not hub._readers
    hub.look_for_ports()
    hub.stop_reading()
    assert list(hub._readers) == ["absent"]
