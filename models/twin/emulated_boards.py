"""The boards of the twin: sampling, the divider, each board's own clock, what gets lost, and what breaks."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..sensor.clock import SEQ_WRAP, WRAP_US
from ..sensor.divider import Divider
from ..values.readings import BoardReading
from ..values.tables import AtLeastOne, NotNegative, Positive, Share

STAMP_S = 1e-6
"""The host's stamps are this fine: two rows of a board never have the same."""


@dataclass(frozen=True, slots=True)
class BoardPhysics:
    """`[boards]` of a plan."""

    tendon_of_channel: list[list[int]]
    """For each board, the tendon wired to each of its channels."""
    period_us: AtLeastOne
    """From row to row, by the board's own clock."""
    rate_error: Share
    """Each board's clock is fast or slow by up to this share of time, drawn evenly."""
    minimum_delay_s: NotNegative
    """From sampling to arrival on the host: what every row takes."""
    delay_s: NotNegative
    """What a row takes longer: the mean of an exponential distribution."""
    lost_rows: Share
    """Share of rows that never arrive."""
    noise_codes: NotNegative
    """Standard deviation of the ADC's white noise."""


@dataclass(frozen=True, slots=True)
class SensorFault:
    """`[[fault.open_circuit]]`, `[[fault.short_circuit]]`, `[[fault.stuck]]`."""

    tendon: int
    from_s: NotNegative
    until_s: Positive


@dataclass(frozen=True, slots=True)
class Spikes:
    """`[[fault.spikes]]`: single rows that are far off."""

    tendon: int
    from_s: NotNegative
    until_s: Positive
    per_s: Positive
    """How many there are on average."""
    codes: Positive
    """By how much they are off at most, either way."""


@dataclass(frozen=True, slots=True)
class ResistanceDrift:
    """`[[fault.resistance_drift]]`: R0 grows (or falls), and stays where it got to."""

    tendon: int
    from_s: NotNegative
    until_s: Positive
    share_per_s: float


@dataclass(frozen=True, slots=True)
class Unplugged:
    """`[[fault.unplugged]]`: the rows of one board are lost, while it goes on counting."""

    board: int
    from_s: NotNegative
    until_s: Positive


PlannedFault = SensorFault | Spikes | ResistanceDrift | Unplugged


@dataclass(frozen=True, slots=True)
class Faults:
    """`[fault]` of a plan: lists of each kind, none if not named. Those of one sensor act in this order."""

    resistance_drift: tuple[ResistanceDrift, ...] = ()
    open_circuit: tuple[SensorFault, ...] = ()
    short_circuit: tuple[SensorFault, ...] = ()
    stuck: tuple[SensorFault, ...] = ()
    spikes: tuple[Spikes, ...] = ()
    unplugged: tuple[Unplugged, ...] = ()

    def each(self) -> list[tuple[str, int, PlannedFault]]:
        """Return every fault with its kind and its number among those."""
        return [(f.name, index, fault) for f in fields(self) for index, fault in enumerate(getattr(self, f.name))]

    def of_sensors(self, tendons: NDArray[np.int64]) -> list[tuple[str, int, PlannedFault]]:
        """Return the faults of the sensors of (channels,) tendons, each with its kind and its channel."""
        channel = {tendon: c for c, tendon in enumerate(tendons.tolist())}
        return [
            (kind, channel[fault.tendon], fault)
            for kind, _, fault in self.each()
            if not isinstance(fault, Unplugged) and fault.tendon in channel
        ]

    def as_truth(self, duration_s: float) -> list[dict[str, Any]]:
        """Return `[[truth.fault]]` of trial.toml, in order of time; a resistance that drifted stays wrong."""
        named = [
            {"kind": kind, "board": fault.board}
            if isinstance(fault, Unplugged)
            else {"kind": kind, "tendon": fault.tendon}
            for kind, _, fault in self.each()
        ]
        times = [
            {"from_s": fault.from_s, "until_s": duration_s if isinstance(fault, ResistanceDrift) else fault.until_s}
            for _, _, fault in self.each()
        ]
        return sorted((name | time for name, time in zip(named, times, strict=True)), key=lambda row: row["from_s"])


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """The sensors' resistance over time, densely sampled."""

    t_s: NDArray[np.float64]
    """(steps,) host clock."""
    resistance_ohm: NDArray[np.float64]
    """(steps, tendons)"""
    noise: NDArray[np.float64]
    """(steps, tendons) standard deviation of its white noise, relative."""

    def at(self, t_s: NDArray[np.float64], tendons: NDArray[np.int64]) -> "Signal":
        """Return the signal of some tendons at other times, linear between the samples."""

        def sampled(values: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.stack([np.interp(t_s, self.t_s, values[:, tendon]) for tendon in tendons], axis=1)

        return Signal(t_s, sampled(self.resistance_ohm), sampled(self.noise))


def board_rows(
    board: int, physics: BoardPhysics, divider: Divider, signal: Signal, faults: Faults, rng: np.random.Generator
) -> list[BoardReading]:
    """Return all rows of one board that arrive on the host, in order."""
    tendons = np.array(physics.tendon_of_channel[board])
    period_s = physics.period_us * 1e-6 * (1 + rng.uniform(-1, 1) * physics.rate_error)
    first_s = rng.uniform(0, period_s)
    first_us = int(rng.integers(500_000, 5_000_000))  # since it was switched on
    t_s = np.arange(first_s, signal.t_s[-1], period_s)
    arrival_s = t_s + physics.minimum_delay_s + physics.delay_s * rng.exponential(size=len(t_s))
    after_s = STAMP_S * np.arange(len(t_s))
    arrival_s = np.maximum.accumulate(arrival_s - after_s) + after_s  # rows come in order, on one line
    arrives = rng.random(len(t_s)) >= physics.lost_rows
    counts = _counts(t_s, tendons, physics, divider, signal, faults, rng)
    for gap in faults.unplugged:
        arrives &= (gap.board != board) | ~_during(gap, t_s)
    return [
        BoardReading(
            board=board,
            host_s=float(arrival_s[k]),
            seq=int(k) % SEQ_WRAP,
            device_us=int(first_us + k * physics.period_us) % WRAP_US,
            counts=counts[k],
        )
        for k in np.flatnonzero(arrives)
    ]


def _counts(
    t_s: NDArray[np.float64],
    tendons: NDArray[np.int64],
    physics: BoardPhysics,
    divider: Divider,
    signal: Signal,
    faults: Faults,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """Return (rows, channels) codes; all channels of a row are read at one instant."""
    here = signal.at(t_s, tendons)
    resistance_ohm = here.resistance_ohm * (1 + here.noise * rng.normal(size=here.noise.shape))
    noise_codes = physics.noise_codes * rng.normal(size=resistance_ohm.shape)
    chance = rng.random(resistance_ohm.shape)
    height = rng.uniform(-1, 1, size=resistance_ohm.shape)
    faults_here = faults.of_sensors(tendons)
    for kind, column, fault in faults_here:
        resistance_ohm[:, column] = _faulty_resistance_ohm(kind, fault, t_s, resistance_ohm[:, column])
    counts = divider.counts(resistance_ohm, noise_codes)
    for kind, column, fault in faults_here:
        during = _during(fault, t_s)
        if isinstance(fault, Spikes):
            during &= chance[:, column] < fault.per_s * physics.period_us * 1e-6
            off = np.round(height[during, column] * fault.codes).astype(np.int64)
            counts[during, column] = np.clip(counts[during, column] + off, 0, divider.codes - 1)
        elif kind == "stuck" and during.any():
            counts[during, column] = counts[during.argmax(), column]
    return counts


def _faulty_resistance_ohm(
    kind: str, fault: PlannedFault, t_s: NDArray[np.float64], resistance_ohm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (rows,) resistance of one sensor with one fault; a fault of its codes leaves it as it is."""
    if isinstance(fault, ResistanceDrift):
        since_s = np.clip(t_s, fault.from_s, fault.until_s) - fault.from_s
        return resistance_ohm * np.maximum(1 + fault.share_per_s * since_s, 0.0)
    if kind in ("open_circuit", "short_circuit"):
        return np.where(_during(fault, t_s), np.inf if kind == "open_circuit" else 0.0, resistance_ohm)
    return resistance_ohm


def _during(fault: PlannedFault, t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    return (t_s >= fault.from_s) & (t_s < fault.until_s)
