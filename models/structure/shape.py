"""The result of an estimator: the shape of the structure at one instant, with its covariance."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from math import isqrt
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..values.chi_squared import chi_squared_quantile, squared_distance
from ..values.errors import InputError
from ..values.readings import TendonLengths
from ..values.slip import Slip
from .external_loads import ExternalLoads
from .floor import EstimatedNormal

Number = TypeVar("Number", np.float64, np.int64)
LEAST_VARIANCE_M2 = 1e-14
"""Variance of the coordinate of an anchor that is known exactly."""


class Status(StrEnum):
    """From which measurements a frame was estimated, and whether that succeeded; `advice` says what to do.

    In order of how little the estimate can be trusted: of several that are true of a frame, the last one stands.
    """

    OK = "ok"
    PARTIAL = "partial"
    TWO_SHAPES = "two_shapes"
    DOUBT = "doubt"
    PRIOR_ONLY = "prior_only"
    NOT_CONVERGED = "not_converged"
    FAILED = "failed"

    @property
    def advice(self) -> str:
        """The meaning of the status, and what the user should do."""
        return ADVICE[self]


ADVICE = {
    Status.OK: "every tendon that moves and has a sensor was measured",
    Status.PARTIAL: "some tendons were left out, see lengths.csv: mend the sensors named there",
    Status.TWO_SHAPES: "another shape or resting face fits about as well, see other_shape.csv: decide by what you saw",
    Status.DOUBT: "the readings fit another explanation better than the model, see the column doubt in status.csv",
    Status.PRIOR_ONLY: "no tendon was measured: the shape is carried on from the frames before and the rest shape",
    Status.NOT_CONVERGED: "the optimiser stopped before its minimum: take this frame with care, or raise noise.*",
    Status.FAILED: "the estimate was impossible: the rest shape stands in its place, and nothing is known of the nodes",
}


class Reason(StrEnum):
    """What explains the readings better than the model; `advice` says what to do."""

    SENSORS = "sensors"
    MOTION = "motion"
    LOADS = "many_loads"
    GEOMETRY = "geometry"
    CHANGE = "change"
    BOARD = "board"
    REST = "rest"
    BASE = "base"
    IMU = "imu"
    CONTACTS = "contacts"
    ATTITUDE = "attitude"
    HANGING = "hanging"
    POSITIONS = "positions"
    RANGES = "ranges"
    FACTOR = "factor"
    MEMORY = "memory"

    @property
    def advice(self) -> str:
        """The meaning of the reason, and what the user should do."""
        return REASON_ADVICE[self]


REASON_ADVICE = {
    Reason.SENSORS: "lengths contradict each other beyond their sigma, or a row repeats: tare again, or calibrate",
    Reason.MOTION: "the robot is shaken faster than its sensors follow: move it slower",
    Reason.LOADS: "many nodes are loaded at once, of which lengths say little: trust the ellipsoids, not the centres",
    Reason.GEOMETRY: "the geometry in trial.toml contradicts itself, or the forces at rest: measure it again, and tell "
    "what the robot carries (knot_mass_kg)",
    Reason.CHANGE: "a rod or a tendon is not as long as at rest: did a clamp slip, a rod bow, a tendon catch?",
    Reason.BOARD: "the sensors of one board are off alike: check its supply, reference and plug, and tare again",
    Reason.REST: "sensors do not fit the rest shape: was it still, are R0, anchors, boards and columns right?",
    Reason.BASE: "the rods turn otherwise than the anchors allow: fix the base, or describe it as free-standing",
    Reason.IMU: "an inertial sensor contradicts gravity, rod, itself, another, or is cut off: check axis, units, range",
    Reason.HANGING: "it is turned otherwise than weight and hands can hold it: fix sensors on rods of other directions",
    Reason.CONTACTS: "what stands by heights cannot carry it: is it held, lifted, on a step? Are sensors on two rods?",
    Reason.POSITIONS: "many positions contradict the robot, or all are shifted: are frame, unit, axes, nodes right?",
    Reason.RANGES: "ranges of several beacons contradict the robot: are these where told, with nothing in between?",
    Reason.FACTOR: "a factor of your own, or a stiff cable, contradicts lengths and forces: is what it says right?",
    Reason.ATTITUDE: "nothing measures how the robot is turned, a push would be missed: add an [[imu]], or [mechanics]",
    Reason.MEMORY: "after presses it seems pulled the other way: calibrate these sensors, which remember more",
}


NO_COVARIANCE = np.zeros((0, 0))
"""The covariance of a shape that is held without it."""


@dataclass(frozen=True, slots=True, eq=False)
class Ellipsoids:
    """Confidence regions of several nodes: each contains its node with a given probability."""

    probability: float
    semi_axis_m: NDArray[np.float64]
    """(..., 3) lengths of the semi-axes, the longest first."""
    axes: NDArray[np.float64]
    """(..., 3, 3) columns are the directions of the semi-axes, right-handed."""

    @property
    def quaternion(self) -> NDArray[np.float64]:
        """(..., 4) x, y, z, w of the rotation that turns the coordinate axes into the semi-axes."""
        from scipy.spatial.transform import Rotation  # a tenth of a second, which an estimate does without

        turns = Rotation.from_matrix(self.axes.reshape(-1, 3, 3))
        return np.asarray(turns.as_quat().reshape(*self.axes.shape[:-2], 4))


def ellipsoids(covariance_m2: NDArray[np.float64], probability: float) -> Ellipsoids:
    """Return the regions (x - mean)^T C^-1 (x - mean) <= chi2_3(probability) of (..., 3, 3) covariances.

    Where a covariance is not known, the semi-axes are nan, and their axes those of the coordinates.

    Raises:
        InputError: for what is no probability between 0 and 1.
    """
    if not 0 < probability < 1:
        raise InputError(f"probability: expected a number between 0 and 1, got {probability}")
    is_known = np.asarray(np.isfinite(covariance_m2).all(axis=(-2, -1)))
    variance, axes = np.linalg.eigh(np.where(is_known[..., None, None], covariance_m2, np.eye(3)))
    variance = np.where(is_known[..., None], np.maximum(variance[..., ::-1], 0.0), np.nan)
    axes = axes[..., ::-1].copy()
    axes[..., 2] *= np.sign(np.linalg.det(axes))[..., None]
    return Ellipsoids(probability, np.sqrt(chi_squared_quantile(probability, 3) * variance), axes)


@dataclass(frozen=True, slots=True, eq=False)
class OtherShape:
    """A second shape that explains a frame about as well: across det J = 0, or the same one on another resting face."""

    node_position_m: NDArray[np.float64]
    """(nodes, 3)"""
    log_ratio: float
    """Log likelihood ratio of the first shape to this one; negative when this one explains the frame better."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """The node positions at one instant, in the coordinate frame of the anchors, of the floor, or of the rest shape."""

    t_s: float
    node_position_m: NDArray[np.float64]
    """(nodes, 3)"""
    covariance_m2: NDArray[np.float64]
    """(3 nodes, 3 nodes) covariance of all coordinates, ordered by node."""
    status: Status
    lengths: TendonLengths
    """The measurement from which the shape was estimated."""
    loads: ExternalLoads | None = None
    """External forces at the nodes; None where the stiffness of the tendons is not known."""
    other: OtherShape | None = None
    """The second shape, when there is one: the status is then `two_shapes`, or a worse one."""
    doubt: Reason | None = None
    """What explains the readings better than the model, when there is such an explanation."""
    contacts: NDArray[np.float64] | None = None
    """(nodes,) probability that the floor carries each node; None where there is no floor."""
    slips: tuple[Slip, ...] = ()
    """Of nodes on the floor that are not where they stood."""
    floor_normal: EstimatedNormal | None = None
    """Of the floor; None where it is told exactly, or there is no floor."""
    factor_innovation: NDArray[np.float64] | None = None
    """(rows,) how far each row of the factors of one's own is from what all else says, over the standard deviation of
    both; nan where nothing was read, None without such factors."""
    contradicted_positions: tuple[int, ...] = ()
    """Nodes of measured positions that contradict shape or pose, and were left out; one entry for each reading."""
    outlying_ranges: tuple[int, ...] = ()
    """Recordings of ranges that contradict the pose, and were left out; one entry for each reading."""

    def __repr__(self) -> str:
        nodes = len(self.node_position_m)
        sigma_mm = 1e3 * self.node_sigma_m.mean()
        return f"Shape(t = {self.t_s:.2f} s, {nodes} nodes, {self.status}, mean sigma of a node {sigma_mm:.2f} mm)"

    def without_covariance(self) -> "Shape":
        """Return the shape with an empty covariance, for where many are held."""
        return replace(self, covariance_m2=NO_COVARIANCE)

    def widened(self, coordinates: NDArray[np.int64], added_m2: NDArray[np.float64]) -> "Shape":
        """Return the shape with a covariance added, (n, n), to that of some of its (n,) coordinates."""
        covariance_m2 = self.covariance_m2.copy()
        covariance_m2[coordinates[:, None], coordinates] += added_m2
        return replace(self, covariance_m2=covariance_m2)

    def widened_by_step(self, coordinates: NDArray[np.int64], step_m: NDArray[np.float64]) -> "Shape":
        """Return this shape, which may be wrong by a step of some coordinates: with its square in the covariance."""
        return self.widened(coordinates, np.outer(step_m, step_m))

    def in_doubt(self, reason: Reason) -> "Shape":
        """Return the shape with the status `doubt` for a reason, unless another reason or a worse status stands.

        That the strips remember more stands to the end of a trial, and gives way to any other reason.
        """
        worse = self.status in (Status.PRIOR_ONLY, Status.NOT_CONVERGED, Status.FAILED)
        stands = self.doubt is not None and self.doubt is not Reason.MEMORY
        return self if worse or stands else replace(self, status=Status.DOUBT, doubt=reason)

    def with_other(self, other: OtherShape) -> "Shape":
        """Return the shape with a second one, and the status `two_shapes` unless a worse status stands."""
        is_told = self.status in (Status.OK, Status.PARTIAL)
        return replace(self, status=Status.TWO_SHAPES if is_told else self.status, other=other)

    def beside(self, other: OtherShape | None) -> "Shape":
        """Return `with_other`; the shape alone where there is no other one, or the ellipsoids hold it."""
        return self if other is None or self.holds(other.node_position_m) else self.with_other(other)

    def holds(self, node_position_m: NDArray[np.float64]) -> bool:
        """Return whether all (nodes, 3) positions are in the ellipsoids of 95 %."""
        apart_m = node_position_m - self.node_position_m
        covariance_m2 = self.node_covariance_m2 + LEAST_VARIANCE_M2 * np.eye(3)
        return bool((squared_distance(apart_m, covariance_m2) <= chi_squared_quantile(0.95, 3)).all())

    @property
    def node_covariance_m2(self) -> NDArray[np.float64]:
        """(nodes, 3, 3) covariance of each node."""
        return node_blocks(self.covariance_m2)

    @property
    def node_sigma_m(self) -> NDArray[np.float64]:
        """(nodes,) square root of the trace of each node's covariance."""
        return node_sigma_m(self.node_covariance_m2)

    def ellipsoids(self, probability: float = 0.95) -> Ellipsoids:
        """Return each node's confidence region."""
        return ellipsoids(self.node_covariance_m2, probability)


def node_blocks(covariance_m2: NDArray[Number]) -> NDArray[Number]:
    """Return the (..., nodes, 3, 3) diagonal blocks of (..., 3 nodes, 3 nodes) covariances."""
    nodes = covariance_m2.shape[-1] // 3
    blocks = covariance_m2.reshape(*covariance_m2.shape[:-2], nodes, 3, nodes, 3)
    return np.asarray(np.einsum("...ninj->...nij", blocks))


def pair_blocks(covariance_m2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (nodes, nodes, 3, 3) the blocks of a (3 nodes, 3 nodes) covariance, of each pair of nodes."""
    nodes = len(covariance_m2) // 3
    return covariance_m2.reshape(nodes, 3, nodes, 3).swapaxes(1, 2)


@dataclass(frozen=True, slots=True, eq=False)
class Covariances:
    """The symmetric covariances of all nodes in many frames, of which the upper triangles are held: half the memory."""

    upper_m2: NDArray[np.float64]
    """(frames, size (size + 1) / 2) the rows of each upper triangle, one after another; size = 3 nodes."""

    @classmethod
    def of(cls, covariances_m2: Iterable[NDArray[np.float64]], size: int) -> "Covariances":
        """Collect (size, size) covariances, one for each frame."""
        row, column = np.triu_indices(size)
        triangles = (covariance_m2[row, column] for covariance_m2 in covariances_m2)
        return cls(np.fromiter(triangles, dtype=np.dtype((np.float64, (len(row),)))))

    @classmethod
    def of_nodes(cls, node_covariance_m2: NDArray[np.float64]) -> "Covariances":
        """Hold (frames, nodes, 3, 3) covariances of single nodes, and nan between nodes."""
        frames, nodes = node_covariance_m2.shape[:2]
        size = 3 * nodes
        unknown = cls(np.full((frames, size * (size + 1) // 2), np.nan))
        unknown.upper_m2[:, node_blocks(_upper_places(size))] = node_covariance_m2
        return unknown

    def part(self, frames: slice) -> "Covariances":
        """Return those of some frames."""
        return Covariances(self.upper_m2[frames])

    def whole_m2(self, frames: int | slice) -> NDArray[np.float64]:
        """Return the (size, size) covariance of a frame, or (frames, size, size) those of some frames."""
        return np.asarray(self.upper_m2[frames][..., _upper_places(self._size)])

    @property
    def node_blocks_m2(self) -> NDArray[np.float64]:
        """(frames, nodes, 3, 3) covariance of each node."""
        return np.asarray(self.upper_m2[:, node_blocks(_upper_places(self._size))])

    @property
    def _size(self) -> int:
        return (isqrt(8 * self.upper_m2.shape[-1] + 1) - 1) // 2


@cache
def _upper_places(size: int) -> NDArray[np.int64]:
    """Return (size, size) where each element of a symmetric matrix stands in the rows of its upper triangle."""
    places = np.zeros((size, size), dtype=np.int64)
    places[np.triu_indices(size)] = np.arange(size * (size + 1) // 2)
    places = np.maximum(places, places.T)
    places.flags.writeable = False
    return places


def node_sigma_m(node_covariance_m2: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (...,) square roots of the traces of (..., 3, 3) covariances."""
    return np.asarray(np.sqrt(np.trace(node_covariance_m2, axis1=-2, axis2=-1)))
