"""A recurrent network alone, for comparison: shapes as in the paper's reference [23], without a model of the robot."""

from collections.abc import Iterable, Iterator

import numpy as np

from ...models.sensor.lstm import Lstm
from ...models.shape_network import LOG_SCALE_RANGE, ShapeNetwork
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Shape
from ...models.structure.structure import Structure
from ...models.values.errors import InputError
from ...models.values.readings import TendonLengths
from ..graph import status_of


class RecurrentNetwork:
    """A network from the dR/R of all sensors to all nodes, frame after frame.

    Raises:
        InputError: when the structure is not the one that the network was trained for.
    """

    def __init__(self, network: ShapeNetwork, structure: Structure, rest: RestShape) -> None:
        network.check(structure, structure.tendon_length_m(rest.node_position_m))
        self._network = network
        self._structure = structure
        self._rest = rest
        self._lstm = Lstm(network.weights)
        self._state = self._lstm.initial_state(1)
        self._change = np.zeros(len(structure.tendons))

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape for each frame."""
        return map(self.update, frames)

    def update(self, lengths: TendonLengths) -> Shape:
        """Return the shape in one more frame; a sensor without a reading holds its last one.

        Raises:
            InputError: for lengths that were not computed from resistance.
        """
        if lengths.change_since_rest is None:
            raise InputError("method 'network': expected counts or resistances, got lengths")
        change = lengths.change_since_rest
        self._change = np.where(np.isfinite(change), change, self._change)
        network, structure = self._network, self._structure
        output, self._state = self._lstm.run(self._change[None, None] / network.change_scale, self._state)
        free = structure.free_coordinates
        position = self._rest.node_position_m.copy().ravel()
        position[free] += network.displacement_scale_m * output[0, 0, :-1]
        covariance = self._rest.covariance_m2.copy()
        scale = np.exp(np.clip(output[0, 0, -1], *LOG_SCALE_RANGE))
        covariance[np.ix_(free, free)] += scale**2 * network.covariance_m2
        return Shape(
            t_s=lengths.t_s,
            node_position_m=position.reshape(-1, 3),
            covariance_m2=covariance,
            status=status_of(lengths, structure),
            lengths=lengths,
        )
