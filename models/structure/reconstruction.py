"""All shapes of one run as arrays, with what follows from them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError
from ..values.readings import TendonLengths
from .external_loads import ExternalLoads
from .lengths import length_jacobian
from .rigidity import branch, free_length_jacobian
from .shape import Ellipsoids, OtherShape, Shape, Status, ellipsoids, node_blocks
from .structure import Structure


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """The shapes of one run, frame by frame, in the frame of the anchors."""

    structure: Structure
    t_s: NDArray[np.float64]
    """(frames,)"""
    node_position_m: NDArray[np.float64]
    """(frames, nodes, 3)"""
    covariance_m2: NDArray[np.float64]
    """(frames, 3 nodes, 3 nodes)"""
    status: tuple[Status, ...]
    """(frames,)"""
    length_m: NDArray[np.float64]
    """(frames, tendons) as measured, nan where not."""
    sigma_m: NDArray[np.float64]
    """(frames, tendons) of the measurement, inf where there is none."""
    mode: NDArray[np.int64]
    """(frames, tendons) `Mode`."""
    flags: NDArray[np.int64]
    """(frames, tendons) `Flag` bits."""
    loads: ExternalLoads | None = None
    """Of all frames; None where the stiffness of the tendons is not known."""
    others: tuple[OtherShape | None, ...] = ()
    """(frames,) the second shape of frames with status `two_shapes`."""
    drift: NDArray[np.float64] | None = None
    """(frames, tendons) what was taken off each resistance, relative to it; None where nothing tells of drift."""
    drift_sigma: NDArray[np.float64] | None = None
    """(frames, tendons) of these."""

    @classmethod
    def of(cls, structure: Structure, shapes: Iterable[Shape]) -> "Reconstruction":
        """Collect shapes.

        Raises:
            InputError: when there are none.
        """
        collected = list(shapes)
        if not collected:
            raise InputError("no frame could be made of the readings")
        each = [shape.loads for shape in collected if shape.loads is not None]
        loads = ExternalLoads(np.array([of.force_n for of in each]), np.array([of.sigma_n for of in each]))
        drifts = [shape.lengths.drift for shape in collected]
        observed = [drift for drift in drifts if drift is not None and drift.references]
        whole = len(observed) == len(collected)
        return cls(
            structure,
            np.array([shape.t_s for shape in collected]),
            np.array([shape.node_position_m for shape in collected]),
            np.array([shape.covariance_m2 for shape in collected]),
            tuple(shape.status for shape in collected),
            np.array([shape.lengths.length_m for shape in collected]),
            np.array([shape.lengths.sigma_m for shape in collected]),
            np.array([shape.lengths.mode for shape in collected]),
            np.array([shape.lengths.flags for shape in collected]),
            loads if len(each) == len(collected) else None,
            tuple(shape.other for shape in collected),
            np.array([drift.change for drift in observed]) if whole else None,
            np.array([drift.sigma for drift in observed]) if whole else None,
        )

    def __len__(self) -> int:
        return len(self.t_s)

    def __iter__(self) -> Iterator[Shape]:
        for k in range(len(self)):
            lengths = TendonLengths(self.t_s[k], self.length_m[k], self.sigma_m[k], self.mode[k], self.flags[k])
            loads = ExternalLoads(self.loads.force_n[k], self.loads.sigma_n[k]) if self.loads else None
            yield Shape(
                self.t_s[k],
                self.node_position_m[k],
                self.covariance_m2[k],
                self.status[k],
                lengths,
                loads,
                self.others[k],
            )

    @property
    def node_covariance_m2(self) -> NDArray[np.float64]:
        """(frames, nodes, 3, 3) covariance of each node."""
        return node_blocks(self.covariance_m2)

    @property
    def node_sigma_m(self) -> NDArray[np.float64]:
        """(frames, nodes) root of the trace of each node's covariance."""
        return np.asarray(np.sqrt(np.trace(self.node_covariance_m2, axis1=-2, axis2=-1)))

    def ellipsoids(self, probability: float = 0.95) -> Ellipsoids:
        """Return the confidence region of every node in every frame."""
        return ellipsoids(self.node_covariance_m2, probability)

    @cached_property
    def predicted_m(self) -> NDArray[np.float64]:
        """(frames, tendons) tendon lengths of the estimated shapes."""
        return self.structure.tendon_length_m(self.node_position_m)

    @cached_property
    def innovation_sigma_m(self) -> NDArray[np.float64]:
        """(frames, tendons) sigma of measured minus predicted.

        The variance is sigma^2 - H P H^T where the shape was estimated from the length, H P H^T alone, that is of the
        prediction, where it was not.
        """
        jacobian = length_jacobian(self.node_position_m, self.structure.tendons)
        jacobian = jacobian.reshape(*jacobian.shape[:2], -1)
        predicted = np.einsum("tei,tij,tej->te", jacobian, self.covariance_m2, jacobian, optimize=True)
        measured = np.isfinite(self.sigma_m)
        left = np.where(measured, self.sigma_m, 0.0) ** 2 - predicted
        return np.asarray(np.sqrt(np.where(measured, np.maximum(left, 1e-12), np.maximum(predicted, 0.0))))

    @cached_property
    def _weakest(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(frames,) smallest singular value of the length Jacobian, (frames, free coordinates) its direction."""
        _, singular_value, motion = np.linalg.svd(free_length_jacobian(self.structure, self.node_position_m))
        full_rank = singular_value.shape[-1] == motion.shape[-1]
        return singular_value[:, -1] if full_rank else np.zeros(len(self)), motion[:, -1]

    @property
    def smallest_singular_value(self) -> NDArray[np.float64]:
        """(frames,) of the length Jacobian of the free nodes: near zero, lengths do not see the mechanism."""
        return self._weakest[0]

    @cached_property
    def branch(self) -> NDArray[np.float64]:
        """(frames,) on which side of det J = 0 the shape stands, 1 or -1; 0 where J is not square."""
        return branch(self.structure, self.node_position_m)

    @cached_property
    def mechanism_sigma_m(self) -> NDArray[np.float64]:
        """(frames,) sigma of the shape along its mechanism, the unit motion that lengths see least."""
        free = self.structure.free_coordinates
        covariance = self.covariance_m2[:, free[:, None], free]
        motion = self._weakest[1]
        return np.asarray(np.sqrt(np.einsum("ti,tij,tj->t", motion, covariance, motion)))
