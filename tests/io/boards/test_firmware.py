"""The real firmware on emulated boards, read through pyserial; skipped, and said so, where the toolchain is absent."""

import time

import numpy as np
import pytest
import serial

from emulated_board import EmulatedBoard
from tensegraph.io.boards.protocol import Decoder, Row, Sample
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


@pytest.fixture(
    params=[(0x40, 0, 0), (0x01, 0, 0), (0x01, 0x08, 0x10), (0x40, 0x10, 0x10)],
    ids=["asleep", "awake", "of another sketch", "put to sleep"],
)
def with_sensor(request, firmware, example, tmp_path):
    """Board 0 with an inertial sensor, whose registers count in steps of 5 ms.

    After power-up an MPU-6050 sleeps, and an MPU-9250 is awake with the ranges 2 g and 250 degrees a second. One that
    kept its power has the ranges of the sketch before, or sleeps.
    """
    count = np.arange(4000)
    steady = np.tile([-2, 4096, 77, 300, -300], (len(count), 1))
    samples = np.column_stack([0.005 * count, count, steady, -count])
    board = EmulatedBoard(firmware, 0, example, tmp_path, rests=20, samples=samples, at_start=request.param)
    board.plug()
    yield board
    board.unplug()


def test_samples_of_an_inertial_sensor_come_between_rows(with_sensor) -> None:
    """At 100 Hz, complete, stamped when they were measured; strain sensors are read as if there were none."""
    messages, counts = listen(with_sensor.port, 2.5)
    rows = [m for m in messages if isinstance(m, Row)]
    samples = [m for m in messages if isinstance(m, Sample)]
    assert counts.bad_crc == counts.garbage == 0
    assert (np.diff([r.seq for r in rows]) == 1).all()
    assert np.ptp((1e-6 * np.array([r.device_us for r in rows]) - 0.02 * np.arange(len(rows)))[1:]) < 50e-6
    assert (np.diff([s.seq for s in samples]) == 1).all()
    measured_s = 1e-6 * np.array([s.device_us for s in samples], dtype=np.uint32).astype(np.int32)  # the first wraps
    period_s = np.diff(measured_s)
    assert period_s.mean() == pytest.approx(0.01, rel=0.01)
    assert np.abs(period_s - 0.01).max() < 0.0025  # a pause comes each 1.25 ms, and none in the last before a row
    # the middle of a sample is as old as the sensor's filter makes it; its stamp is half a period later
    for s, read_s in zip(samples, measured_s + 0.0049 - 0.005, strict=True):
        assert s.force[0] == -s.rate[2] == pytest.approx(read_s / 0.005, abs=1.2)
        assert s.force[1:] == (-2, 4096)
        assert s.rate[:2] == (300, -300)
    assert 4096 * samples[0].force_unit_m_per_s2 == pytest.approx(9.80665)
    assert 32768 * samples[0].rate_unit_rad_per_s == pytest.approx(np.deg2rad(1000))


def test_a_sensor_that_is_off_the_bus_is_taken_on_when_it_is_back(with_sensor) -> None:
    """It has forgotten its ranges and sleeps: it is set up anew. The rows go on."""
    listen(with_sensor.port, 1.0)
    with_sensor.plug_sensor()
    listen(with_sensor.port, 0.5)
    without, _ = listen(with_sensor.port, 1.2)
    assert not any(isinstance(m, Sample) for m in without)
    with_sensor.plug_sensor()
    back, counts = listen(with_sensor.port, 3.0)
    samples = [m for m in back if isinstance(m, Sample)]
    assert counts.bad_crc == counts.garbage == 0
    assert samples
    assert all(s.force[1:] == (-2, 4096) for s in samples)  # a sleeping sensor reads zeros
    for messages in (without, back):
        assert (np.diff([m.seq for m in messages if isinstance(m, Row)]) == 1).all()
