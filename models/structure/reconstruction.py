"""All shapes of one run as arrays, and the quantities that are derived from them."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError
from ..values.readings import TendonLengths
from ..values.slip import Slip, slides
from ..values.time_series import parts
from .external_loads import ExternalLoads
from .floor import EstimatedNormal
from .labelled import as_dataframe, as_dataset, columns_of
from .lengths import length_jacobian, propagated_variance
from .rigidity import branch, held_jacobian
from .shape import Covariances, Ellipsoids, OtherShape, Reason, Shape, Status, ellipsoids, node_sigma_m
from .structure import Structure

if TYPE_CHECKING:
    import pandas
    import xarray


CoordinateFrame = Literal["anchors", "world", "body"]
"""That of the anchors, the world with its floor, or that of the rest shape of a structure that is held in a hand."""
BLOCK_FRAMES = 1000
"""Frames whose matrices are made at a time, so that those of half an hour do not take gigabytes."""


def coordinate_frame_of(structure: Structure, *, has_floor: bool) -> CoordinateFrame:
    """Return in which frame the shapes of a structure are described."""
    if not structure.is_free_standing:
        return "anchors"
    return "world" if has_floor else "body"


@dataclass(frozen=True, slots=True, eq=False)
class Propagated:
    """What follows from the covariances between nodes, of a run whose files hold only each node's own covariance."""

    innovation_sigma_m: NDArray[np.float64]
    """(frames, tendons) see `Reconstruction.innovation_sigma_m`."""
    mechanism_sigma_m: NDArray[np.float64]
    """(frames,) see `Reconstruction.mechanism_sigma_m`."""
    centroid_covariance_m2: NDArray[np.float64]
    """(frames, 3, 3) see `Reconstruction.centroid_covariance_m2`; nan where it was not written."""

    def part(self, frames: slice) -> "Propagated":
        """Return that of some frames."""
        return Propagated(
            self.innovation_sigma_m[frames], self.mechanism_sigma_m[frames], self.centroid_covariance_m2[frames]
        )


def _covariances(shapes: Iterable[Shape], structure: Structure, collected: list[Shape]) -> Covariances:
    """Return the covariances of all shapes, and collect the shapes without theirs.

    So there is never a second copy of them: in half an hour of 50 frames a second they take half a gigabyte. What else
    no result holds, such as the lengths in each mode, is let go of, too.
    """

    def taken() -> Iterator[NDArray[np.float64]]:
        for shape in shapes:
            _check_size(shape, structure)
            lengths = replace(shape.lengths, modes=None, aids=(), change_since_rest=None, natural=None)
            collected.append(replace(shape.without_covariance(), lengths=lengths))
            yield shape.covariance_m2

    return Covariances.of(taken(), 3 * structure.node_count)


def _check_size(shape: Shape, structure: Structure) -> None:
    """Raise InputError for a shape of another structure."""
    nodes, tendons = len(shape.node_position_m), len(shape.lengths.length_m)
    if (nodes, tendons) != (structure.node_count, len(structure.tendons)):
        expected = f"{structure.node_count} nodes and {len(structure.tendons)} tendons"
        raise InputError(f"expected shapes of the structure, with {expected}, got one with {nodes} and {tendons}")


def _drift(shapes: Sequence[Shape]) -> tuple[NDArray[np.float64], NDArray[np.float64]] | tuple[None, None]:
    """Return (frames, tendons) the drift of the sensors and its sigma; nan in frames in which nothing shows it."""
    drifts = [shape.lengths.drift for shape in shapes]
    shown = [drift if drift is not None and drift.is_shown else None for drift in drifts]
    if not any(shown):
        return None, None
    unknown = np.full(len(shapes[0].lengths.length_m), np.nan)
    return (
        np.array([drift.change if drift else unknown for drift in shown]),
        np.array([drift.sigma if drift else unknown for drift in shown]),
    )


@dataclass(frozen=True, eq=False, repr=False)
class Reconstruction:
    """The shapes of all frames of one run, in one coordinate frame, see `Shape`.

    `result[3.2]` is the `Shape` of the frame nearest to 3.2 s, `result[2.0:5.0]` the frames from 2 s to before 5 s. A
    shape between frames is not interpolated: its covariance would be that of no estimate.
    """

    structure: Structure
    t_s: NDArray[np.float64]
    """(frames,)"""
    node_position_m: NDArray[np.float64]
    """(frames, nodes, 3)"""
    covariances: Covariances
    """Of all nodes in each frame; nan between different nodes in a run that was loaded from files."""
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
    """(frames,) the second shape of each frame that has one."""
    doubts: tuple[Reason | None, ...] = ()
    """(frames,) what explains the readings of a frame better than the model; None where nothing does."""
    drift: NDArray[np.float64] | None = None
    """(frames, tendons) drift that was taken off each resistance, relative to it; nan in frames in which nothing shows
    it, None where nothing does in any."""
    drift_sigma: NDArray[np.float64] | None = None
    """(frames, tendons) standard deviation of `drift`."""
    contacts: NDArray[np.float64] | None = None
    """(frames, nodes) probability that the floor carries each node; None where there is no floor."""
    slips: tuple[tuple[Slip, ...], ...] = ()
    """(frames,) of nodes on the floor that are not where they stood."""
    floor_normal: EstimatedNormal | None = None
    """Of the floor, as the last frame tells it; None where it is told exactly, or there is no floor."""
    contradicted_positions: tuple[tuple[int, ...], ...] = ()
    """(frames,) see `Shape.contradicted_positions`; empty in a run that was loaded from files."""
    propagated: Propagated | None = None
    """What was written of a run that was loaded from files; None where it is computed from `covariances`."""

    @classmethod
    def of(cls, structure: Structure, shapes: Iterable[Shape]) -> "Reconstruction":
        """Collect the shapes of one run.

        Raises:
            InputError: when there is no shape, or one of another structure.
        """
        collected: list[Shape] = []
        covariances = _covariances(shapes, structure, collected)
        if not collected:
            raise InputError("no frame could be made of the readings")
        known_loads = [shape.loads for shape in collected if shape.loads is not None]
        loads = ExternalLoads(
            force_n=np.array([frame_loads.force_n for frame_loads in known_loads]),
            sigma_n=np.array([frame_loads.sigma_n for frame_loads in known_loads]),
        )
        drift, drift_sigma = _drift(collected)
        contacts = [shape.contacts for shape in collected if shape.contacts is not None]
        return cls(
            structure=structure,
            t_s=np.array([shape.t_s for shape in collected]),
            node_position_m=np.array([shape.node_position_m for shape in collected]),
            covariances=covariances,
            status=tuple(shape.status for shape in collected),
            length_m=np.array([shape.lengths.length_m for shape in collected]),
            sigma_m=np.array([shape.lengths.sigma_m for shape in collected]),
            mode=np.array([shape.lengths.mode for shape in collected]),
            flags=np.array([shape.lengths.flags for shape in collected]),
            loads=loads if len(known_loads) == len(collected) else None,
            others=tuple(shape.other for shape in collected),
            doubts=tuple(shape.doubt for shape in collected),
            drift=drift,
            drift_sigma=drift_sigma,
            contacts=np.array(contacts) if contacts else None,
            slips=tuple(shape.slips for shape in collected),
            floor_normal=collected[-1].floor_normal,
            contradicted_positions=tuple(shape.contradicted_positions for shape in collected),
        )

    @property
    def slides(self) -> list[Slip]:
        """The slips of all frames, with those of one slide added up."""
        return slides([slip for frame in self.slips for slip in frame])

    def __len__(self) -> int:
        return len(self.t_s)

    def __iter__(self) -> Iterator[Shape]:
        return (self._shape(k) for k in range(len(self)))

    @overload
    def __getitem__(self, t_s: float) -> Shape: ...

    @overload
    def __getitem__(self, t_s: slice) -> "Reconstruction": ...

    def __getitem__(self, t_s: float | slice) -> "Shape | Reconstruction":
        """Return the frame nearest to a time, or those from a time to before another, in seconds on the host's clock.

        Raises:
            InputError: for a time outside the run, times that no frame is between, or what is no time.
        """
        if isinstance(t_s, slice):
            return self._between(t_s)
        return self._shape(self.frame_at(t_s))

    def frame_at(self, t_s: float) -> int:
        """Return the number of the frame nearest to a time.

        Raises:
            InputError: for a time outside the run, or what is no time.
        """
        is_number = isinstance(t_s, int | float | np.integer | np.floating)
        if not is_number or not self.t_s[0] <= t_s <= self.t_s[-1]:
            got = repr(t_s) if is_number or isinstance(t_s, str) else type(t_s).__name__
            raise InputError(f"result[{got}]: expected a time from {self.t_s[0]:.4f} to {self.t_s[-1]:.4f} s")
        return int(np.abs(self.t_s - t_s).argmin())

    def _between(self, times: slice) -> "Reconstruction":
        where = f"result[{times.start}:{times.stop}]"
        if times.step is not None or any(isinstance(t, str | bytes) for t in (times.start, times.stop)):
            raise InputError(f"{where}: expected two times in seconds, as in result[2.0:5.0], got {times}")
        first = 0 if times.start is None else int(np.searchsorted(self.t_s, times.start))
        last = len(self) if times.stop is None else int(np.searchsorted(self.t_s, times.stop))
        if first >= last:
            raise InputError(f"{where}: holds no frame: the run is from {self.t_s[0]:.4f} to {self.t_s[-1]:.4f} s")
        return self._part(slice(first, last))

    def _part(self, frames: slice) -> "Reconstruction":
        """Return some of the frames."""
        return replace(
            self,
            t_s=self.t_s[frames],
            node_position_m=self.node_position_m[frames],
            covariances=self.covariances.part(frames),
            status=self.status[frames],
            length_m=self.length_m[frames],
            sigma_m=self.sigma_m[frames],
            mode=self.mode[frames],
            flags=self.flags[frames],
            loads=self.loads.part(frames) if self.loads else None,
            others=self.others[frames],
            doubts=self.doubts[frames],
            drift=None if self.drift is None else self.drift[frames],
            drift_sigma=None if self.drift_sigma is None else self.drift_sigma[frames],
            contacts=None if self.contacts is None else self.contacts[frames],
            slips=self.slips[frames],
            contradicted_positions=self.contradicted_positions[frames],
            propagated=self.propagated.part(frames) if self.propagated else None,
        )

    def _shape(self, k: int) -> Shape:
        """Return the shape of frame `k`."""
        return Shape(
            t_s=self.t_s[k],
            node_position_m=self.node_position_m[k],
            covariance_m2=self.covariances.whole_m2(k),
            status=self.status[k],
            lengths=TendonLengths(
                t_s=self.t_s[k],
                length_m=self.length_m[k],
                sigma_m=self.sigma_m[k],
                mode=self.mode[k],
                flags=self.flags[k],
            ),
            loads=self.loads.part(k) if self.loads else None,
            other=self.others[k] if self.others else None,
            doubt=self.doubts[k] if self.doubts else None,
            contacts=self.contacts[k] if self.contacts is not None else None,
            slips=self.slips[k] if self.slips else (),
            floor_normal=self.floor_normal,
            contradicted_positions=self.contradicted_positions[k] if self.contradicted_positions else (),
        )

    def _summary(self) -> dict[str, str]:
        counts = Counter(self.status)
        free = self.structure.free_nodes
        return {
            "frames": f"{len(self)}, from {self.t_s[0]:.2f} to {self.t_s[-1]:.2f} s",
            "structure": f"{self.structure.node_count} nodes, {len(self.structure.tendons)} tendons",
            "coordinate frame": self.coordinate_frame,
            "status": ", ".join(f"{count} {status}" for status, count in counts.items()),
            "mean sigma of a node": f"{1e3 * self.node_sigma_m[:, free].mean():.2f} mm",
        }

    def __repr__(self) -> str:
        return f"Reconstruction({'; '.join(f'{name}: {text}' for name, text in self._summary().items())})"

    def _repr_html_(self) -> str:
        """Return a table for notebooks."""
        rows = (f"<tr><th>{name}</th><td>{escape(text)}</td></tr>" for name, text in self._summary().items())
        return f"<table><caption>Reconstruction</caption>{''.join(rows)}</table>"

    @property
    def coordinate_frame(self) -> CoordinateFrame:
        """See `coordinate_frame_of`."""
        return coordinate_frame_of(self.structure, has_floor=self.contacts is not None)

    def arrays(self, probability: float = 0.95) -> dict[str, NDArray[Any]]:
        """Return all quantities of the run by name, see `QUANTITIES`.

        Args:
            probability: of the ellipsoids.
        """
        s = self.structure
        return {
            **self._arrays_of_frames(),
            **self._arrays_of_nodes(probability),
            **self._arrays_of_tendons(),
            "rods": s.rods,
            "rod_length_m": s.rod_length_m,
            "tendons": s.tendons,
            "natural_length_m": s.natural_length_m,
            "is_anchor": np.isin(np.arange(s.node_count), s.anchors).astype(np.int64),
        }

    def _arrays_of_frames(self) -> dict[str, NDArray[Any]]:
        others = self.others or (None,) * len(self)
        covariance_m2 = self.centroid_covariance_m2  # of a run that was read, it is that of track.csv
        return {
            "t_s": self.t_s,
            "status": np.array([str(status) for status in self.status]),
            "doubt": np.array([str(doubt or "none") for doubt in self.doubts or others]),
            "smallest_singular_value": self.smallest_singular_value,
            "mechanism_sigma_m": self.mechanism_sigma_m,
            "branch": self.branch,
            "other_log_ratio": np.array([other.log_ratio if other else np.nan for other in others]),
            "centroid_m": self.centroid_m,
        } | ({"centroid_covariance_m2": covariance_m2} if np.isfinite(covariance_m2).any() else {})

    def _arrays_of_nodes(self, probability: float) -> dict[str, NDArray[Any]]:
        regions = self.ellipsoids(probability)
        arrays = {
            "node_position_m": self.node_position_m,
            "node_covariance_m2": self.node_covariance_m2,
            "semi_axis_m": regions.semi_axis_m,
            "ellipsoid_quaternion": regions.quaternion,
        }
        if any(self.others):
            nowhere = np.full_like(self.node_position_m[0], np.nan)
            positions = [other.node_position_m if other else nowhere for other in self.others]
            arrays["other_position_m"] = np.array(positions)
        if self.loads is not None:
            arrays |= {"load_n": self.loads.force_n, "load_sigma_n": self.loads.sigma_n}
        if self.contacts is not None:
            arrays["contact_probability"] = self.contacts
        return arrays

    def _arrays_of_tendons(self) -> dict[str, NDArray[Any]]:
        names = ("length_m", "sigma_m", "mode", "flags", "predicted_m", "innovation_sigma_m", "drift", "drift_sigma")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    def to_xarray(self, probability: float = 0.95) -> "xarray.Dataset":
        """Return all quantities as a dataset with units, whose dimensions are time, nodes, tendons, axes and rods.

        Args:
            probability: of the ellipsoids.

        Raises:
            InputError: when xarray is not installed.
        """
        return as_dataset(self.arrays(probability), self._attributes(probability))

    def to_dataframe(
        self, table: Literal["frames", "nodes", "tendons"] = "frames", probability: float = 0.95
    ) -> "pandas.DataFrame":
        """Return a table: one row for each frame, for each frame and node, or for each frame and tendon.

        Args:
            table: `frames` has the quantities of nodes and tendons too, in columns such as `n0_x_m` and `t0_length_m`.
            probability: of the ellipsoids.

        Raises:
            InputError: when pandas is not installed, or there is no such table.
        """
        return as_dataframe(columns_of(self.arrays(probability), table), self._attributes(probability))

    def _attributes(self, probability: float) -> dict[str, Any]:
        return {"coordinate_frame": self.coordinate_frame, "probability": probability}

    @property
    def covariance_m2(self) -> NDArray[np.float64]:
        """(frames, 3 nodes, 3 nodes) `covariances`, whole: of half an hour it takes a gigabyte."""
        return self.covariances.whole_m2(slice(None))

    @property
    def node_covariance_m2(self) -> NDArray[np.float64]:
        """(frames, nodes, 3, 3) covariance of each node."""
        return self.covariances.node_blocks_m2

    @property
    def centroid_m(self) -> NDArray[np.float64]:
        """(frames, 3) mean of all nodes: the track of a free-standing robot."""
        return np.asarray(self.node_position_m.mean(axis=1))

    @property
    def centroid_covariance_m2(self) -> NDArray[np.float64]:
        """(frames, 3, 3) covariance of `centroid_m`."""
        if self.propagated is not None:
            return self.propagated.centroid_covariance_m2
        nodes = self.structure.node_count
        sums = [
            self.covariances.whole_m2(block).reshape(-1, nodes, 3, nodes, 3).sum(axis=(1, 3))
            for block in parts(len(self), BLOCK_FRAMES)
        ]
        return np.concatenate(sums) / nodes**2

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
        H P H^T, the variance of the prediction. P contains more than what the readings of the frame leave unknown, as
        loads that may be hidden; where H P H^T is larger than sigma^2 by that, the result is nan.
        """
        if self.propagated is not None:
            return self.propagated.innovation_sigma_m
        tendons = self.structure.tendons
        predicted = np.concatenate(
            [
                propagated_variance(
                    length_jacobian(self.node_position_m[block], tendons), self.covariances.whole_m2(block)
                )
                for block in parts(len(self), BLOCK_FRAMES)
            ]
        )
        measured = np.isfinite(self.sigma_m)
        difference = np.where(measured, self.sigma_m, 0.0) ** 2 - predicted
        variance = np.where(measured, difference, np.maximum(predicted, 0.0))
        return np.sqrt(np.where(variance > 0, variance, np.where(measured, np.nan, 0.0)))

    @cached_property
    def _smallest_singular(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(frames,) smallest singular value of the length Jacobian, (frames, free coordinates) its right vector."""
        singular_value, motion = [], []
        for block in parts(len(self), BLOCK_FRAMES):
            jacobian = held_jacobian(self.structure, self.node_position_m[block])
            square, vector = np.linalg.eigh(np.swapaxes(jacobian, 1, 2) @ jacobian)
            rows, columns = jacobian.shape[1:]
            singular_value.append(np.sqrt(np.maximum(square[:, 0], 0.0)) if rows >= columns else np.zeros(len(square)))
            motion.append(vector[:, :, 0].copy())  # a view would keep all vectors
        return np.concatenate(singular_value), np.concatenate(motion)

    @property
    def smallest_singular_value(self) -> NDArray[np.float64]:
        """(frames,) smallest singular value of the length Jacobian of the free nodes.

        When it is near zero, the lengths do not determine the motion along the mechanism.
        """
        return self._smallest_singular[0]

    @cached_property
    def branch(self) -> NDArray[np.float64]:
        """(frames,) sign of det J at the shape, 1 or -1; 0 where J is not square."""
        return np.concatenate(
            [branch(self.structure, self.node_position_m[block]) for block in parts(len(self), BLOCK_FRAMES)]
        )

    @cached_property
    def mechanism_sigma_m(self) -> NDArray[np.float64]:
        """(frames,) sigma of the shape along its mechanism, the unit motion that changes the lengths least."""
        if self.propagated is not None:
            return self.propagated.mechanism_sigma_m
        free = self.structure.free_coordinates
        motion = self._smallest_singular[1]
        variance = [
            propagated_variance(motion[block, None, :], self.covariances.whole_m2(block)[:, free[:, None], free])[:, 0]
            for block in parts(len(self), BLOCK_FRAMES)
        ]
        return np.sqrt(np.concatenate(variance))
