"""The twin's boards: clocks, jitter, lost rows, faults."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tensegraph.models.sensor.clock import BoardClock, ClockSettings
from tensegraph.models.sensor.divider import Divider
from tensegraph.models.twin.emulated_boards import (
    BoardPhysics,
    Faults,
    ResistanceDrift,
    SensorFault,
    Signal,
    Spikes,
    Unplugged,
    board_rows,
)

DIVIDER = Divider(10, 5.8e6, "ground")


QUIET = BoardPhysics([[0, 1], [2]], 20_000, 0.0, 0.002, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def signal() -> Signal:
    """30 s of three sensors: steady, rising by half, steady."""
    t_s = np.arange(0, 30, 0.001)
    resistance = np.stack([np.full_like(t_s, 5.8e6), 5.8e6 * (1 + t_s / 60), np.full_like(t_s, 2.9e6)], axis=1)
    return Signal(t_s, resistance, np.zeros_like(resistance))


def counts_of(signal, faults=None, board=0, physics=QUIET, seed=0):
    rows = board_rows(board, physics, DIVIDER, signal, faults or Faults(), np.random.default_rng(seed))
    return np.array([row.host_s for row in rows]), np.array([row.counts for row in rows]), rows


@pytest.mark.parametrize("side", ["ground", "supply"])
def test_a_code_means_its_resistance_and_the_other_way_round(side) -> None:
    divider = Divider(10, 5.8e6, side)
    codes = np.arange(1024)
    np.testing.assert_array_equal(divider.counts(divider.resistance_ohm(codes)), codes)
    open_and_short = divider.counts(np.array([np.inf, 0.0]))
    np.testing.assert_array_equal(open_and_short, [1023, 0] if side == "ground" else [0, 1023])


def test_a_quiet_board_is_a_sampled_divider(signal) -> None:
    host_s, counts, rows = counts_of(signal)
    assert len(rows) in (1499, 1500)
    np.testing.assert_array_equal(counts[:, 0], 512)
    resistance = 5.8e6 * (1 + (host_s - 0.002) / 60)
    np.testing.assert_array_equal(counts[:, 1], DIVIDER.counts(resistance))
    assert {b.device_us - a.device_us for a, b in pairwise(rows)} == {20_000}


def test_clocks_jitter_and_loss_are_as_said(signal) -> None:
    physics = replace(QUIET, rate_error=0.005, delay_s=0.0015, lost_rows=0.02)
    for seed in range(3):
        host_s, _, rows = counts_of(signal, physics=physics, seed=seed)
        seq = np.array([row.seq for row in rows])
        assert 0.005 < 1 - len(seq) / (seq[-1] + 1) < 0.04
        assert (np.diff(host_s) > 0).all()
        rate, start_s = np.polyfit(seq, host_s, 1)
        assert abs(rate / 0.02 - 1) <= 0.0051
        late_s = host_s - (start_s + rate * seq)
        assert late_s.std() == pytest.approx(0.0015, rel=0.2)


def test_the_estimator_s_clock_finds_when_rows_were_sampled(signal) -> None:
    """Two parts that know nothing of each other: the board that makes the stamps, and the clock that undoes them."""
    physics = replace(QUIET, rate_error=150e-6, delay_s=0.0015, lost_rows=0.004)
    _, counts, rows = counts_of(signal, physics=physics)
    clock = BoardClock(ClockSettings())
    times = np.array([clock.time_s(row) for row in rows])
    ramp = (DIVIDER.resistance_ohm(counts[:, 1]) / 5.8e6 - 1) * 60
    assert abs((ramp - times)[200:].mean()) < 0.01  # a code is 0.2 s of the ramp, and averages out
    assert np.abs(np.diff(times) / np.diff([row.seq for row in rows]) - 0.02)[200:].max() < 2e-4


def test_counters_wrap() -> None:
    t_s = np.array([0.0, 80.0])
    signal = Signal(t_s, np.full((2, 3), 5.8e6), np.zeros((2, 3)))
    _, _, rows = counts_of(signal, physics=replace(QUIET, period_us=1000))
    assert max(row.seq for row in rows) == 65535
    assert rows[65536].seq == 0


def test_each_fault_is_what_it_says(signal) -> None:
    faults = Faults(
        open_circuit=[SensorFault(0, 1.0, 2.0)],
        short_circuit=[SensorFault(0, 3.0, 4.0)],
        stuck=[SensorFault(1, 10.0, 30.0)],
        spikes=[Spikes(0, 5.0, 29.0, 2.0, 400.0)],
        unplugged=[Unplugged(1, 7.0, 9.0)],
        resistance_drift=[ResistanceDrift(2, 10.0, 20.0, 0.01)],
    )
    host_s, counts, _ = counts_of(signal, faults)
    t_s = host_s - 0.002
    clean = counts_of(signal)[1]
    np.testing.assert_array_equal(counts[(t_s > 1) & (t_s < 2), 0], 1023)
    np.testing.assert_array_equal(counts[(t_s > 3) & (t_s < 4), 0], 0)
    assert len(set(counts[t_s > 10.001, 1])) == 1
    assert len(set(clean[t_s > 10.001, 1])) > 50
    off = counts[t_s > 5, 0] != 512
    assert 24 < off.sum() < 80
    np.testing.assert_array_equal(counts[t_s < 1], clean[t_s < 1])
    host_s, counts, rows = counts_of(signal, faults, board=1)
    assert not ((host_s > 7.01) & (host_s < 9)).any()
    assert max(b.seq - a.seq for a, b in pairwise(rows)) == 101
    np.testing.assert_array_equal(counts[host_s > 20.1, 0], DIVIDER.counts(np.array(2.9e6 * 1.1)))
    truth = faults.as_truth(60.0)
    assert [row["kind"] for row in truth] == [
        "open_circuit", "short_circuit", "spikes", "unplugged", "resistance_drift", "stuck",
    ]  # fmt: skip
    assert [row["until_s"] for row in truth] == [2.0, 4.0, 29.0, 9.0, 60.0, 30.0]  # a drifted resistance stays wrong


def test_an_open_circuit_stays_open_however_the_resistance_drifts(signal) -> None:
    """Infinity times zero, where the resistance has fallen to nothing, would be no code at all."""
    faults = Faults(open_circuit=[SensorFault(0, 1.0, 3.0)], resistance_drift=[ResistanceDrift(0, 0.5, 5.0, -0.9)])
    host_s, counts, _ = counts_of(signal, faults)
    t_s = host_s - 0.002
    np.testing.assert_array_equal(counts[(t_s > 1.01) & (t_s < 2.99), 0], 1023)
    np.testing.assert_array_equal(counts[t_s > 3.01, 0], 0)


@pytest.mark.parametrize("change", [0.0, 1.0])
def test_noise_is_relative_to_the_resistance_and_that_of_codes_is_on_top(change) -> None:
    t_s = np.array([0.0, 40.0])
    signal = Signal(t_s, np.full((2, 3), 5.8e6 * (1 + change)), np.full((2, 3), 0.02))
    _, counts, _ = counts_of(signal)
    share = DIVIDER.resistance_ohm(counts) / (5.8e6 * (1 + change))
    assert share.std() == pytest.approx(0.02, rel=0.05)
    still = Signal(t_s, signal.resistance_ohm, np.zeros((2, 3)))
    _, counts, _ = counts_of(still, physics=replace(QUIET, noise_codes=5.0))
    assert counts.std(axis=0).mean() == pytest.approx(5.0, rel=0.05)
