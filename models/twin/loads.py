"""External loads on the twin at single nodes: presses, squeezes, holds and random presses, as forces over time.

Each grows from zero to its force F in the ramp time r, is held for a time h, and fades in the same way as it grew:

    F(t) = F (1 - cos(pi t / r)) / 2        0 <= t < r
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..values.tables import AtLeastOne, NotNegative, Positive


class Timed(Protocol):
    """A load that grows, is held, and fades."""

    @property
    def at_s(self) -> float:
        """When it begins."""
        ...

    @property
    def ramp_s(self) -> float:
        """How long it grows, and again how long it fades."""
        ...

    @property
    def hold_s(self) -> float:
        """How long it is held; infinite if it does not end."""
        ...


class Load(Protocol):
    """A load on some nodes."""

    @property
    def when(self) -> Timed:
        """When it acts."""
        ...

    def full_n(self, t_s: float, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces while it is held, at a time, when the nodes are at (nodes, 3)."""
        ...


class _OwnTimes:
    """A load whose own table tells when it acts."""

    __slots__ = ()

    @property
    def when(self: Timed) -> Timed:
        """When it acts."""
        return self


@dataclass(frozen=True, slots=True)
class Press(_OwnTimes):
    """`[[load.press]]`: a force of fixed direction on some nodes."""

    at_s: NotNegative
    """When it begins."""
    ramp_s: Positive
    hold_s: NotNegative
    nodes: list[int]
    """Each of them is pressed with the whole force."""
    force_n: Positive
    direction: tuple[float, float, float]
    """Its length does not matter."""
    during_rest: bool = False
    """Whether it may begin within the seconds of rest, as if somebody touched the structure while sensors are tared."""

    def full_n(self, t_s: float, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces while it is held."""
        return _pushed_n(self, node_position_m)


@dataclass(frozen=True, slots=True)
class Squeeze(_OwnTimes):
    """`[[load.squeeze]]`: two nodes are pushed towards each other, wherever they are."""

    at_s: NotNegative
    ramp_s: Positive
    hold_s: NotNegative
    nodes: tuple[int, int]
    force_n: Positive
    during_rest: bool = False
    """See `Press`."""

    def full_n(self, t_s: float, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces while it is held, along the line between both nodes."""
        a, b = self.nodes
        between_m = node_position_m[b] - node_position_m[a]
        force_n = np.zeros_like(node_position_m)
        force_n[a] = self.force_n * between_m / np.linalg.norm(between_m)
        force_n[b] = -force_n[a]
        return force_n


@dataclass(frozen=True, slots=True)
class Hold(_OwnTimes):
    """`[[load.hold]]`: a press that does not end."""

    at_s: NotNegative
    ramp_s: Positive
    nodes: list[int]
    force_n: Positive
    direction: tuple[float, float, float]
    during_rest: bool = False
    """See `Press`."""

    @property
    def hold_s(self) -> float:
        """It does not end."""
        return np.inf

    def full_n(self, t_s: float, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces from the end of its ramp on."""
        return _pushed_n(self, node_position_m)


@dataclass(frozen=True, slots=True)
class Window:
    """The time in which one load acts, see `Timed`."""

    at_s: float
    ramp_s: float
    hold_s: float


@dataclass(frozen=True, slots=True)
class RandomTimes:
    """Loads one after another; the seed draws their times evenly from these ranges."""

    from_s: NotNegative
    until_s: Positive
    pause_s: tuple[NotNegative, NotNegative]
    """Shortest and longest time between two."""
    duration_s: tuple[Positive, Positive]
    """Shortest and longest time from the beginning of one to its end."""
    ramp_share: Positive
    """Share of the duration that each of the two ramps takes."""

    def windows(self, rng: np.random.Generator) -> Iterator[Window]:
        """Yield the time in which each acts; other numbers may be drawn from `rng` before the next is asked for."""
        at_s = self.from_s + rng.uniform(*self.pause_s)
        while at_s + (duration_s := rng.uniform(*self.duration_s)) < self.until_s:
            ramp_s = self.ramp_share * duration_s
            yield Window(at_s, ramp_s, duration_s - 2 * ramp_s)
            at_s += duration_s + rng.uniform(*self.pause_s)


@dataclass(frozen=True, slots=True)
class RandomPresses(RandomTimes):
    """`[[load.random]]`: presses one after another, each drawn evenly from these ranges by the seed."""

    nodes: list[int]
    """Those that may be pressed."""
    together: tuple[AtLeastOne, AtLeastOne]
    """Fewest and most nodes pressed at once; each has its own force and direction."""
    force_n: tuple[Positive, Positive]
    direction: tuple[float, float, float]
    """The mean direction; zero: none."""
    direction_sigma: tuple[NotNegative, NotNegative, NotNegative]
    """How far a direction differs from it, normally distributed per axis."""

    def draw(self, rng: np.random.Generator) -> list[Press]:
        """Return the presses that one seed draws."""
        presses: list[Press] = []
        for when in self.windows(rng):
            for node in rng.choice(self.nodes, rng.integers(*self.together, endpoint=True), replace=False):
                x, y, z = rng.normal(self.direction, self.direction_sigma)
                force_n = rng.uniform(*self.force_n)
                presses.append(
                    Press(
                        at_s=when.at_s,
                        ramp_s=when.ramp_s,
                        hold_s=when.hold_s,
                        nodes=[int(node)],
                        force_n=force_n,
                        direction=(x, y, z),
                    )
                )
        return presses


class Loads:
    """The force on every node at any time, of some loads together."""

    def __init__(self, loads: Sequence[Load]) -> None:
        self._loads = loads

    def force_n(self, t_s: float, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces at a time, when the nodes are at (nodes, 3)."""
        force_n = np.zeros_like(node_position_m)
        for load in self._loads:
            if share := share_of(load.when, t_s):
                force_n += share * load.full_n(t_s, node_position_m)
        return force_n


def share_of(load: Timed, t_s: float) -> float:
    """Return which share of its force a load has at a time, from 0 to 1."""
    since_s = t_s - load.at_s
    left_s = 2 * load.ramp_s + load.hold_s - since_s
    ramp = min(since_s, left_s, load.ramp_s) / load.ramp_s
    return float((1 - np.cos(np.pi * ramp)) / 2) if ramp > 0 else 0.0


def _pushed_n(load: Press | Hold, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (nodes, 3) forces of a fixed direction."""
    force_n = np.zeros_like(node_position_m)
    force_n[load.nodes] = load.force_n * np.array(load.direction) / np.linalg.norm(load.direction)
    return force_n
