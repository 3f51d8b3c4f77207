"""The balance of forces in all frames of a trial: natural lengths, support and standard deviation of each frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...models.balance.observable_loads import external_loads
from ...models.balance.statics import Statics
from ...models.balance.support import Support
from ...models.values.readings import NaturalLengths, TendonLengths
from ...models.values.time_series import parts
from ..graph import NEAR_M, GraphBuilder, are_near
from .parts import STACKED, Frames


@dataclass(frozen=True, slots=True, eq=False)
class TrialBalance:
    """The balance of forces of a structure in all frames, near some shapes."""

    statics: Statics
    """The balance at the natural lengths of the rest, on the support that it has where no other is told."""
    natural: tuple[NaturalLengths, ...]
    """(frames,) the natural lengths; empty where no motor changes any."""
    natural_m: NDArray[np.float64]
    """(frames, tendons) the natural lengths as taring corrects them; no rows where no motor changes any."""
    supports: Support | None
    """Force of gravity and floor in each frame, stacked; None where it is always the same."""
    sigma_n: NDArray[np.float64]
    """(frames, rows) standard deviation of the balance at a node without load, near the shapes."""

    @classmethod
    def of(
        cls, builder: GraphBuilder, frames: Sequence[TendonLengths], supports: Sequence[Support] | None
    ) -> "TrialBalance | None":
        """Return the balance in some frames, without its standard deviation; None without mechanics."""
        mechanics, statics = builder.rest.mechanics, builder.statics
        if mechanics is None or statics is None:
            return None
        natural = tuple(lengths.natural for lengths in frames if lengths.natural is not None)
        change_m = np.array([one.length_m - builder.structure.natural_length_m for one in natural])
        stacked = None
        if supports is not None:
            force_n = np.array([support.force_n for support in supports])
            stacked = Support(force_n, np.array([support.covariance_n2 for support in supports]))
        natural_m = mechanics.natural_length_m + change_m if natural else np.zeros((0, len(builder.structure.tendons)))
        return cls(statics, natural, natural_m, stacked, np.zeros((0, len(statics.group))))

    @classmethod
    def of_newest(cls, builder: GraphBuilder, count: int) -> "TrialBalance | None":
        """Return the balance in the newest frame that was added to a graph, `count` times; None without mechanics."""
        if builder.statics is None:
            return None
        no_natural_m = np.zeros((0, len(builder.structure.tendons)))
        return cls(builder.statics, (), no_natural_m, None, np.tile(builder.force_sigma_n, (count, 1)))

    def statics_of(self, frames: Frames) -> Statics:
        """Return the balance in some of the frames, stacked."""
        statics = self.statics
        if self.natural:
            statics = statics.wound(self.natural_m[frames])
        if self.supports is not None:
            statics = statics.supported(self.supports.part(frames))
        return statics

    def part(self, frames: NDArray[np.int64]) -> "TrialBalance":
        """Return the balance of some of the frames alone."""
        supports = self.supports.part(frames) if self.supports else None
        natural = tuple(self.natural[k] for k in frames) if self.natural else ()
        natural_m = self.natural_m[frames] if natural else self.natural_m
        return replace(self, natural=natural, natural_m=natural_m, supports=supports, sigma_n=self.sigma_n[frames])

    def load_n(self, node_position_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (frames, nodes, 3) the loads that balance the forces of (frames, nodes, 3) shapes; nan at anchors."""
        loads = []
        for frames in parts(len(node_position_m), STACKED):
            statics, x = self.statics_of(frames), node_position_m[frames]
            residual_n = statics.residual_n(x)
            loads.append(external_loads(statics, x, residual_n, np.zeros_like(residual_n)).force_n)
        return np.concatenate(loads)

    def near(self, builder: GraphBuilder, node_position_m: NDArray[np.float64]) -> "TrialBalance":
        """Return the balance with its standard deviation near (frames, nodes, 3) shapes.

        As by `GraphBuilder.approach`, it is that of the last frame from which no node has moved by `NEAR_M`.
        """
        near = self._near_frames(node_position_m)
        new, of_frame = np.unique(near, return_inverse=True)
        by_mechanics = [
            self._by_mechanics_n2(builder, node_position_m[new[k]], new[k]) for k in parts(len(new), STACKED)
        ]
        variance = np.concatenate(by_mechanics)[of_frame]
        for frames in parts(len(near), STACKED):
            variance[frames] += self.statics_of(frames).support_variance_n2(node_position_m[near[frames]])
        return replace(self, sigma_n=np.sqrt(variance))

    def _by_mechanics_n2(
        self, builder: GraphBuilder, node_position_m: NDArray[np.float64], frames: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return (frames, rows) the variance of the balance, but for that of the support."""
        sigma_m = np.array([self.natural[k].sigma_m for k in frames]) if self.natural else None
        return builder.balance_variance_n2(self.statics_of(frames), node_position_m, sigma_m)

    def _near_frames(self, node_position_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return (frames,) the last frame that was not near the one before it, of each frame."""
        near = np.zeros(len(node_position_m), dtype=np.int64)
        last = 0
        for k, x in enumerate(node_position_m):
            moved = np.abs(x - node_position_m[last]).max() >= NEAR_M
            if moved or (self.natural and not are_near(self.natural[last], self.natural[k])):
                last = k
            near[k] = last
        return near
