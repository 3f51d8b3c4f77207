"""All shapes of one run as arrays, and the quantities that are derived from them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError
from ..values.readings import TendonLengths
from .external_loads import ExternalLoads
from .lengths import length_jacobian, propagated_variance
from .rigidity import branch, held_jacobian
from .shape import Ellipsoids, OtherShape, Reason, Shape, Status, ellipsoids, node_blocks, node_sigma_m
from .slip import Slip, slides
from .structure import Structure


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """The shapes of all frames of one run, in one coordinate frame, see `Shape`."""

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
    """(frames, tendons) measured lengths; nan where no length was measured."""
    sigma_m: NDArray[np.float64]
    """(frames, tendons) standard deviation of the measured length; inf where no length was measured."""
    mode: NDArray[np.int64]
    """(frames, tendons) `Mode`."""
    flags: NDArray[np.int64]
    """(frames, tendons) `Flag` bits."""
    loads: ExternalLoads | None = None
    """Estimated loads in all frames; None where the stiffness of the tendons is not known."""
    others: tuple[OtherShape | None, ...] = ()
    """(frames,) the second shape of frames with status `two_shapes`."""
    doubts: tuple[Reason | None, ...] = ()
    """(frames,) what explains the readings of a frame better than the model; None where nothing does."""
    drift: NDArray[np.float64] | None = None
    """(frames, tendons) drift that was taken off each resistance, relative to it; None where nothing shows drift."""
    drift_sigma: NDArray[np.float64] | None = None
    """(frames, tendons) standard deviation of `drift`."""
    contacts: NDArray[np.float64] | None = None
    """(frames, nodes) probability that the floor carries each node; None where there is no floor."""
    slips: tuple[tuple[Slip, ...], ...] = ()
    """(frames,) of nodes on the floor that are not where they stood."""

    @classmethod
    def of(cls, structure: Structure, shapes: Iterable[Shape]) -> "Reconstruction":
        """Collect the shapes of one run.

        Raises:
            InputError: when there is no shape.
        """
        collected = list(shapes)
        if not collected:
            raise InputError("no frame could be made of the readings")
        known_loads = [shape.loads for shape in collected if shape.loads is not None]
        loads = ExternalLoads(
            force_n=np.array([frame_loads.force_n for frame_loads in known_loads]),
            sigma_n=np.array([frame_loads.sigma_n for frame_loads in known_loads]),
        )
        drifts = [shape.lengths.drift for shape in collected]
        observed = [drift for drift in drifts if drift is not None and drift.references]
        drift_is_known = len(observed) == len(collected)
        contacts = [shape.contacts for shape in collected if shape.contacts is not None]
        return cls(
            structure=structure,
            t_s=np.array([shape.t_s for shape in collected]),
            node_position_m=np.array([shape.node_position_m for shape in collected]),
            covariance_m2=np.array([shape.covariance_m2 for shape in collected]),
            status=tuple(shape.status for shape in collected),
            length_m=np.array([shape.lengths.length_m for shape in collected]),
            sigma_m=np.array([shape.lengths.sigma_m for shape in collected]),
            mode=np.array([shape.lengths.mode for shape in collected]),
            flags=np.array([shape.lengths.flags for shape in collected]),
            loads=loads if len(known_loads) == len(collected) else None,
            others=tuple(shape.other for shape in collected),
            doubts=tuple(shape.doubt for shape in collected),
            drift=np.array([drift.change for drift in observed]) if drift_is_known else None,
            drift_sigma=np.array([drift.sigma for drift in observed]) if drift_is_known else None,
            contacts=np.array(contacts) if contacts else None,
            slips=tuple(shape.slips for shape in collected),
        )

    @property
    def slides(self) -> list[Slip]:
        """The slips of all frames, with those of one slide added up."""
        return slides([slip for frame in self.slips for slip in frame])

    def __len__(self) -> int:
        return len(self.t_s)

    def __iter__(self) -> Iterator[Shape]:
        for k in range(len(self)):
            lengths = TendonLengths(
                t_s=self.t_s[k],
                length_m=self.length_m[k],
                sigma_m=self.sigma_m[k],
                mode=self.mode[k],
                flags=self.flags[k],
            )
            loads = ExternalLoads(self.loads.force_n[k], self.loads.sigma_n[k]) if self.loads else None
            yield Shape(
                t_s=self.t_s[k],
                node_position_m=self.node_position_m[k],
                covariance_m2=self.covariance_m2[k],
                status=self.status[k],
                lengths=lengths,
                loads=loads,
                other=self.others[k],
                doubt=self.doubts[k],
                contacts=self.contacts[k] if self.contacts is not None else None,
                slips=self.slips[k] if self.slips else (),
            )

    @property
    def node_covariance_m2(self) -> NDArray[np.float64]:
        """(frames, nodes, 3, 3) covariance of each node."""
        return node_blocks(self.covariance_m2)

    @property
    def centroid_m(self) -> NDArray[np.float64]:
        """(frames, 3) mean of all nodes: the track of a free-standing robot."""
        return np.asarray(self.node_position_m.mean(axis=1))

    @property
    def centroid_covariance_m2(self) -> NDArray[np.float64]:
        """(frames, 3, 3) covariance of `centroid_m`."""
        nodes = self.structure.node_count
        blocks = self.covariance_m2.reshape(len(self), nodes, 3, nodes, 3)
        return np.asarray(blocks.sum(axis=(1, 3)) / nodes**2)

    @property
    def node_sigma_m(self) -> NDArray[np.float64]:
        """(frames, nodes) square root of the trace of each node's covariance."""
        return node_sigma_m(self.node_covariance_m2)

    def ellipsoids(self, probability: float = 0.95) -> Ellipsoids:
        """Return the confidence region of every node in every frame."""
        return ellipsoids(self.node_covariance_m2, probability)

    @cached_property
    def predicted_m(self) -> NDArray[np.float64]:
        """(frames, tendons) tendon lengths of the estimated shapes."""
        return self.structure.tendon_length_m(self.node_position_m)

    @cached_property
    def innovation_sigma_m(self) -> NDArray[np.float64]:
        """(frames, tendons) standard deviation of measured minus predicted length.

        The variance is sigma^2 - H P H^T where the shape was estimated from the length. Where it was not, it is
        H P H^T, the variance of the prediction.
        """
        jacobian = length_jacobian(self.node_position_m, self.structure.tendons)
        predicted = propagated_variance(jacobian, self.covariance_m2)
        measured = np.isfinite(self.sigma_m)
        difference = np.where(measured, self.sigma_m, 0.0) ** 2 - predicted
        return np.asarray(np.sqrt(np.where(measured, np.maximum(difference, 1e-12), np.maximum(predicted, 0.0))))

    @cached_property
    def _smallest_singular(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(frames,) smallest singular value of the length Jacobian, (frames, free coordinates) its right vector."""
        _, singular_value, motion = np.linalg.svd(held_jacobian(self.structure, self.node_position_m))
        full_rank = singular_value.shape[-1] == motion.shape[-1]
        return singular_value[:, -1] if full_rank else np.zeros(len(self)), motion[:, -1]

    @property
    def smallest_singular_value(self) -> NDArray[np.float64]:
        """(frames,) smallest singular value of the length Jacobian of the free nodes.

        When it is near zero, the lengths do not determine the motion along the mechanism.
        """
        return self._smallest_singular[0]

    @cached_property
    def branch(self) -> NDArray[np.float64]:
        """(frames,) sign of det J at the shape, 1 or -1; 0 where J is not square."""
        return branch(self.structure, self.node_position_m)

    @cached_property
    def mechanism_sigma_m(self) -> NDArray[np.float64]:
        """(frames,) sigma of the shape along its mechanism, the unit motion that changes the lengths least."""
        free = self.structure.free_coordinates
        covariance = self.covariance_m2[:, free[:, None], free]
        motion = self._smallest_singular[1]
        return np.sqrt(propagated_variance(motion[:, None, :], covariance)[:, 0])
