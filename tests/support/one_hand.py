"""A hand that loads a structure, for watches that tell from loads what is wrong."""

from dataclasses import replace

import numpy as np

from tensegraph import Status
from tensegraph.models.structure.external_loads import ExternalLoads
from tensegraph.models.structure.shape import Reason, Shape

STEP_S = 0.02
NODE = 8


class Hand:
    """Loads one node of a structure at rest, as a watch sees it."""

    def __init__(self, watch, rest, lengths_of) -> None:
        self.rest = rest
        self.watch = watch
        self.lengths = lengths_of(rest.structure, rest.node_position_m)
        self.t_s = 0.0

    def load(self, force_n: float, seconds: float, doubt: Reason | None = None, moved_m: float = 0.0) -> Shape:
        """Return the last shape of a time in which a force acts upwards on the node, or seems to."""
        node_count = self.rest.structure.node_count
        loads = ExternalLoads.unknown(node_count)
        loads.force_n[self.rest.structure.free_nodes] = 0.0
        loads.force_n[NODE] = [0.0, 0.0, force_n]
        position_m = self.rest.node_position_m.copy()
        position_m[NODE, 2] += moved_m
        for _ in range(round(seconds / STEP_S)):
            self.t_s += STEP_S
            shape = Shape(
                t_s=self.t_s,
                node_position_m=position_m,
                covariance_m2=1e-6 * np.eye(3 * node_count),
                status=Status.OK,
                lengths=replace(self.lengths, t_s=self.t_s),
                loads=loads,
                doubt=doubt,
            )
            shape = self.watch.observe(shape)
        return shape

    def press(self, rebound_n: float) -> Shape:
        """Return the last shape of a press with 2 N, with what seems to follow it, and a rest."""
        self.load(-2.0, 1.0)
        self.load(rebound_n, 0.5)
        return self.load(0.0, 2.0)
