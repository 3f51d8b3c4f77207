"""The real firmware on emulated boards, read through pyserial; skipped, and said so, where the toolchain is absent."""

import time

import numpy as np
import serial

from tensegraph.io.boards.protocol import Decoder, Row
from tensegraph.models.values.link import Hello


def listen(port, seconds: float):
    """Return what a board says, and its decoder's counts."""
    messages, decoder = [], Decoder()
    with serial.Serial(str(port), 500_000, timeout=0.1) as line:
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            messages += decoder.feed(line.read(max(1, line.in_waiting)))
    return messages, decoder.counts


def test_rows_and_hellos_of_a_board(emulated, example) -> None:
    """On schedule, complete, and the codes that the pins' voltages stand for, though neighbours differ by 70 codes.

    The emulator models the charge that the hold capacitor carries from pin to pin: without the dummy read and the
    waiting after it the codes would be wrong by up to 19 % of the difference.
    """
    emulated[0].unplug()
    messages, counts = listen(emulated[1].port, 3.0)
    rows = [m for m in messages if isinstance(m, Row)]
    hellos = [m for m in messages if isinstance(m, Hello)]
    assert counts.bad_crc == counts.garbage == 0
    assert len(hellos) >= 2
    assert all(h.board_id == 1 and h.boot == 0 and h.rate_hz == 50 and h.channels == 12 for h in hellos)
    assert (np.diff([r.seq for r in rows]) == 1).all()
    device_s = 1e-6 * np.array([r.device_us for r in rows])
    assert np.ptp((device_s - 0.02 * np.arange(len(rows)))[1:]) < 50e-6  # hardware-timed; micros() counts in steps of 4
    played = np.loadtxt(example / "board1.csv", delimiter=",", skiprows=1)
    resting = played[played[:, 0] < 2.0, 3:]  # comes again and again
    at = np.floor(device_s / 0.02).astype(int)
    near = np.stack([resting[(at + shift) % len(resting)] for shift in (-1, 0, 1)])  # a trial row or so about the scan
    codes = np.array([r.codes for r in rows])
    assert ((codes >= near.min(axis=0) - 1) & (codes <= near.max(axis=0) + 1)).all()


def test_a_restarted_board_counts_its_boots(emulated) -> None:
    emulated[1].unplug()
    emulated[0].unplug()
    emulated[0].plug()
    messages, _ = listen(emulated[0].port, 1.2)
    assert {m.boot for m in messages} == {1}
    assert min(m.seq for m in messages if isinstance(m, Row)) < 20
