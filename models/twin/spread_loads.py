"""Loads on many nodes at once, and loads that swing or follow the nodes: hugs, tips, lifts, shakes and wind."""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from ..structure.floor import UP
from ..values.rotations import rotation
from ..values.tables import AtLeastOne, NotNegative, Positive, Share
from .loads import RandomTimes, Window, share_of

MIDDLE_M = 1e-6
"""A node that is closer than this to the point to which a hug pushes it is not pushed: no direction is defined."""
HELD = 3
"""Number of nodes that a hand holds that lifts a structure."""


@dataclass(frozen=True, slots=True)
class RandomHugs(RandomTimes):
    """`[[load.hug]]`: many nodes at once are pushed towards their middle, again and again."""

    nodes: list[int]
    """Those that may be pushed."""
    together: tuple[AtLeastOne, AtLeastOne]
    """Fewest and most nodes pushed at once."""
    force_n: tuple[Positive, Positive]
    """Least and largest force at a node, averaged over the nodes of one hug."""
    force_spread: Share
    """The force at a node is that force times a number from 1 minus this to 1 plus this, drawn evenly."""
    axis: tuple[float, float, float]
    """Direction of a line through the middle of the nodes, towards which nodes are pushed at a right angle, as by arms
    around the body. Zero: they are pushed towards the middle itself."""
    direction_sigma: NotNegative
    """Standard deviation, per axis, of what is added to the unit vector of a node's force."""

    def draw(self, rng: np.random.Generator) -> list["Hug"]:
        """Return the hugs that one seed draws."""
        hugs: list[Hug] = []
        for when in self.windows(rng):
            count = rng.integers(*self.together, endpoint=True)
            nodes = rng.choice(self.nodes, count, replace=False)
            force_n = rng.uniform(*self.force_n) * (1 + self.force_spread * rng.uniform(-1, 1, size=count))
            off = self.direction_sigma * rng.normal(size=(count, 3))
            hugs.append(Hug(when=when, nodes=nodes, force_n=force_n, axis=np.array(self.axis), off=off))
        return hugs


@dataclass(frozen=True, slots=True, eq=False)
class Hug:
    """One hug."""

    when: Window
    nodes: NDArray[np.int64]
    """(hugged,)"""
    force_n: NDArray[np.float64]
    """(hugged,) size of the force at each."""
    axis: NDArray[np.float64]
    """(3,) of any length, or zero, see `RandomHugs`."""
    off: NDArray[np.float64]
    """(hugged, 3) added to the unit vector that points inwards."""

    def full_n(self, t_s: float, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces; their directions follow the nodes."""
        position_m = node_position_m[self.nodes]
        inward_m = position_m.mean(axis=0) - position_m
        if self.axis.any():
            axis = self.axis / np.linalg.norm(self.axis)
            inward_m = inward_m - np.outer(inward_m @ axis, axis)
        distance_m = np.linalg.norm(inward_m, axis=1)
        has_direction = distance_m > MIDDLE_M
        direction = inward_m / np.where(has_direction, distance_m, 1.0)[:, None] + self.off
        direction /= np.linalg.norm(direction, axis=1, keepdims=True) + np.finfo(np.float64).tiny
        full_n = np.zeros_like(node_position_m)
        full_n[self.nodes] = (has_direction * self.force_n)[:, None] * direction
        return full_n


@dataclass(frozen=True, slots=True)
class RandomTips(RandomTimes):
    """`[[load.tip]]`: a hand pushes the highest nodes sideways, so that a free-standing structure tips."""

    nodes: list[int]
    """Those that may be pushed."""
    force_n: tuple[Positive, Positive]
    """Least and largest force of a push, over all pushed nodes."""

    def draw(self, rng: np.random.Generator) -> list["Tip"]:
        """Return the pushes that one seed draws."""
        tips = []
        for when in self.windows(rng):
            heading = rng.uniform(0, 2 * np.pi)
            direction = np.array([np.cos(heading), np.sin(heading), 0.0])
            tips.append(Tip(when, np.array(self.nodes), rng.uniform(*self.force_n) * direction))
        return tips


@dataclass(frozen=True, slots=True, eq=False)
class Tip:
    """One push."""

    when: Window
    nodes: NDArray[np.int64]
    """(nodes,) those that may be pushed."""
    force_n: NDArray[np.float64]
    """(3,) over all pushed nodes."""

    def full_n(self, t_s: float, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces at the two highest nodes."""
        highest = self.nodes[np.argsort(node_position_m[self.nodes, 2])[-2:]]
        full_n = np.zeros_like(node_position_m)
        full_n[highest] = self.force_n / len(highest)
        return full_n


@dataclass(frozen=True, slots=True)
class RandomLifts(RandomTimes):
    """`[[load.lift]]`: a hand lifts a free-standing structure, carries it aside, turns it, and sets it down.

    It holds the three nodes that are highest when it begins, each by a spring and a damper whose force grows and fades
    as the hand rises and sinks. It carries and turns the structure from the middle of the rise to the middle of the
    time in the air, and holds still from then on.
    """

    nodes: list[int]
    """Those that may be held."""
    height_m: tuple[Positive, Positive]
    """Least and largest rise of the hand."""
    aside_m: tuple[NotNegative, NotNegative]
    """Shortest and longest way of the hand, in any direction along the ground."""
    turn_rad: tuple[float, float]
    """Least and largest turn about the vertical, to the left."""
    stiffness_n_per_m: Positive
    """Of the spring at each node."""
    damping_n_s_per_m: NotNegative
    """Of the damper at each node."""

    def draw(self, rng: np.random.Generator) -> list["Lift"]:
        """Return the lifts that one seed draws."""
        lifts = []
        for when in self.windows(rng):
            heading = rng.uniform(0, 2 * np.pi)
            way_m = rng.uniform(*self.aside_m) * np.array([np.cos(heading), np.sin(heading), 0.0])
            height_m, turn_rad = rng.uniform(*self.height_m), rng.uniform(*self.turn_rad)
            hand = self.stiffness_n_per_m, self.damping_n_s_per_m
            lifts.append(Lift(when, np.array(self.nodes), height_m, way_m, turn_rad, *hand))
        return lifts


@dataclass(slots=True, eq=False)
class Lift:
    """One lift, see `RandomLifts`. It remembers what it holds: times are asked for in their order."""

    when: Window
    nodes: NDArray[np.int64]
    """(nodes,) those that may be held."""
    height_m: float
    way_m: NDArray[np.float64]
    """(3,) along the ground."""
    turn_rad: float
    stiffness_n_per_m: float
    damping_n_s_per_m: float
    _grip: tuple[NDArray[np.int64], NDArray[np.float64]] | None = field(default=None, init=False)
    """(3,) nodes that the hand holds, and (3, 3) where they were when it took them."""
    _before: tuple[float, NDArray[np.float64]] | None = field(default=None, init=False)
    """Time of the last force, and (3, 3) from the nodes to the hand then."""

    def full_n(self, t_s: float, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces of the springs and dampers."""
        if self._grip is None:
            highest = self.nodes[np.argsort(node_position_m[self.nodes, 2])[-HELD:]]
            self._grip = highest, node_position_m[highest]
        held, grip_m = self._grip
        apart_m = self._hand_m(t_s, grip_m) - node_position_m[held]
        force_n = self.stiffness_n_per_m * apart_m
        if self._before is not None:
            before_s, before_m = self._before
            force_n += self.damping_n_s_per_m * (apart_m - before_m) / (t_s - before_s)
        self._before = t_s, apart_m
        full_n = np.zeros_like(node_position_m)
        full_n[held] = force_n
        return full_n

    def _hand_m(self, t_s: float, grip_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (3, 3) where the hand has the nodes that were at (3, 3) when it took them."""
        when = self.when
        share = np.clip((t_s - when.at_s - when.ramp_s / 2) / ((when.ramp_s + when.hold_s) / 2), 0.0, 1.0)
        carried = (1 - np.cos(np.pi * share)) / 2
        middle_m = grip_m.mean(axis=0)
        turned_m = (grip_m - middle_m) @ rotation(carried * self.turn_rad * UP).T
        hand_m = middle_m + carried * self.way_m + self.height_m * share_of(when, t_s) * UP
        return np.asarray(hand_m + turned_m)


@dataclass(frozen=True, slots=True)
class RandomShakes(RandomTimes):
    """`[[load.shake]]`: some nodes are shaken by a force F sin(2 pi f t), again and again."""

    nodes: list[int]
    """Those that may be shaken."""
    together: tuple[AtLeastOne, AtLeastOne]
    """Fewest and most nodes shaken at once, in phase and by the same force, as by one hand or one motor."""
    force_n: tuple[Positive, Positive]
    """Least and largest amplitude F at each node."""
    frequency_hz: tuple[Positive, Positive]
    """Lowest and highest f."""
    direction: tuple[float, float, float]
    """The mean direction; zero: none."""
    direction_sigma: tuple[NotNegative, NotNegative, NotNegative]
    """How far a direction differs from it, normally distributed per axis."""

    def draw(self, rng: np.random.Generator) -> list["Shake"]:
        """Return the shakes that one seed draws."""
        shakes: list[Shake] = []
        for when in self.windows(rng):
            nodes = rng.choice(self.nodes, rng.integers(*self.together, endpoint=True), replace=False)
            direction = rng.normal(self.direction, self.direction_sigma)
            force_n = rng.uniform(*self.force_n) * direction / np.linalg.norm(direction)
            shakes.append(Shake(when, nodes, force_n, rng.uniform(*self.frequency_hz)))
        return shakes


@dataclass(frozen=True, slots=True, eq=False)
class Shake:
    """One shake."""

    when: Window
    nodes: NDArray[np.int64]
    force_n: NDArray[np.float64]
    """(3,) amplitude."""
    frequency_hz: float

    def full_n(self, t_s: float, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces."""
        full_n = np.zeros_like(node_position_m)
        full_n[self.nodes] = self.force_n * np.sin(2 * np.pi * self.frequency_hz * (t_s - self.when.at_s))
        return full_n


@dataclass(frozen=True, slots=True)
class WindPlan:
    """`[[load.wind]]`: a force of one direction on many nodes, which varies slowly and does not end.

    At a node it is F c (1 + g (sin(2 pi t / T1 + p1) + sin(2 pi t / T2 + p2))); each node has its own c.
    """

    at_s: NotNegative
    """When it begins."""
    ramp_s: Positive
    """How long it grows."""
    nodes: list[int]
    """Those on which it blows."""
    force_n: Positive
    """F, the mean over the nodes."""
    force_spread: Share
    """c is drawn evenly from 1 minus this to 1 plus this, once for each node."""
    direction: tuple[float, float, float]
    """Its length does not matter."""
    gust_share: Annotated[float, Interval(ge=0, le=0.5)]
    """g, the standard deviation of the gusts; up to 0.5, the wind never reverses."""
    gust_period_s: tuple[Positive, Positive]
    """Shortest and longest period: T1 and T2 are drawn evenly from this range, and the phases p1 and p2 from a full
    turn."""

    def draw(self, rng: np.random.Generator) -> "Wind":
        """Return the wind that one seed draws."""
        caught = 1 + self.force_spread * rng.uniform(-1, 1, size=len(self.nodes))
        direction = np.array(self.direction) / np.linalg.norm(self.direction)
        return Wind(
            when=Window(self.at_s, self.ramp_s, np.inf),
            nodes=np.array(self.nodes),
            force_n=self.force_n * np.outer(caught, direction),
            gust_share=self.gust_share,
            gust_period_s=rng.uniform(*self.gust_period_s, size=2),
            gust_phase=rng.uniform(0, 2 * np.pi, size=2),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Wind:
    """A wind as it blows, see `WindPlan`."""

    when: Window
    nodes: NDArray[np.int64]
    """(blown,)"""
    force_n: NDArray[np.float64]
    """(blown, 3) without gusts."""
    gust_share: float
    gust_period_s: NDArray[np.float64]
    """(2,)"""
    gust_phase: NDArray[np.float64]
    """(2,)"""

    def full_n(self, t_s: float, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (nodes, 3) forces."""
        gust = np.sin(2 * np.pi * t_s / self.gust_period_s + self.gust_phase).sum()
        full_n = np.zeros_like(node_position_m)
        full_n[self.nodes] = (1 + self.gust_share * gust) * self.force_n
        return full_n
