"""Positions in a frame of their own: where the frame of a motion capture is in the world.

It is found while the robot is at rest. There the nodes are at x, as the rest shape says, and the motion capture sees k
of them at y, in its own frame. With the means x' and y' over these nodes, the rotation R that fits best gives

    x = x' + R (y - y')

The fit is wrong by a turn d about x' and by a shift e. A node that is placed at x is in truth at

    x + B (d, e),    B = [-[x - x']_x, 1],    cov (d, e) = A V A^T,    A = (B^T B)^-1 B^T over the nodes at rest,

with V the covariance of the rest shape and of the readings. These are six numbers and not four: a ground plane is
calibrated to some tenths of a degree, and the floor of the world is that of the rest shape.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..structure.rest_shape import RestShape
from ..values.aids import OwnFrame, PositionReading
from ..values.rotations import best_rotation, cross_matrix
from ..values.stamps import RestClock

LEAST_NODES = 3
"""Number of nodes that tell a frame."""
MOST_TURN_RAD = 0.05
"""Standard deviation of the turn about the line on which the nodes lie best, above which they are on one line: the
errors of a frame are used as if they were small."""
MOST_MISFIT = 5.0
"""Misfit of a fit, in standard deviations, above which it is wrong: a marker is at another node, or a unit is wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameFit:
    """What the positions at rest say of one frame."""

    recording: int
    """Number of the recording."""
    nodes: tuple[int, ...]
    """The nodes that were seen at rest."""
    frame: OwnFrame | None
    """Where the frame is; None where it is not known."""
    misfit_m: float = float("nan")
    """Root mean square of a coordinate's residual."""
    unknown: str = ""
    """Why it is not known."""

    def text(self) -> str:
        """Return one line for the summary of a run."""
        if self.frame is None:
            return f"not known, its positions are not used: {self.unknown}"
        place = ", ".join(f"{value:.3f}" for value in self.frame.origin_m)
        return (
            f"origin at ({place}) m, sigma {1e3 * self.frame.origin_sigma_m.max():.1f} mm; turn with a sigma of "
            f"{np.rad2deg(self.frame.turn_sigma_rad.max()):.2f} degrees; {len(self.nodes)} nodes fit to "
            f"{1e3 * self.misfit_m:.2f} mm"
        )

    def as_table(self) -> dict[str, Any]:
        """Return the table of run.toml."""
        table: dict[str, Any] = {"recording": self.recording, "nodes": list(self.nodes)}
        if self.frame is None:
            return table | {"unknown": self.unknown}
        return table | {
            "misfit_m": round(self.misfit_m, 6),
            "quaternion": self.frame.quaternion.round(8).tolist(),
            "turn_sigma_rad": self.frame.turn_sigma_rad.round(6).tolist(),
            "origin_m": self.frame.origin_m.round(6).tolist(),
            "origin_sigma_m": self.frame.origin_sigma_m.round(6).tolist(),
        }


class OwnFrames:
    """Places positions of such recordings in the world, from the end of the rest on."""

    def __init__(self, rest: RestShape, recordings: Sequence[int], rest_clock: RestClock, sigma_m: float) -> None:
        self._rest = rest
        self._rest_clock = rest_clock
        self._sigma_m = sigma_m
        self._at_rest: dict[int, dict[int, list[NDArray[np.float64]]]] = {k: defaultdict(list) for k in recordings}
        self._fits: dict[int, FrameFit] = {}
        self._left_out = dict.fromkeys(recordings, 0)

    @property
    def fits(self) -> list[FrameFit]:
        """What is known of each frame: in the end, or so far."""
        return [self._fits.get(recording) or self._fit(recording) for recording in self._at_rest]

    def placed(self, reading: PositionReading) -> PositionReading | None:
        """Return a position in the world; None at rest, where it tells the frame, and where the frame is not known."""
        if reading.recording not in self._at_rest:
            return reading
        if self._rest_clock.is_at_rest(reading.t_s):
            self._at_rest[reading.recording][reading.node].append(reading.position_m)
            return None
        if reading.recording not in self._fits:
            self._fits[reading.recording] = self._fit(reading.recording)
        frame = self._fits[reading.recording].frame
        if frame is None:
            self._left_out[reading.recording] += 1
            return None
        return replace(reading, position_m=frame.world_m(reading.position_m), frame=frame)

    def counts(self) -> dict[str, int]:
        """Return the number of positions that were left out because their frame is not known."""
        return {f"position {recording}: rows in an unknown frame": n for recording, n in self._left_out.items()}

    def as_table(self) -> dict[str, Any]:
        """Return the tables `[[own_frame]]` of run.toml; nothing without such recordings."""
        return {"own_frame": [fit.as_table() for fit in self.fits]} if self._at_rest else {}

    def _fit(self, recording: int) -> FrameFit:
        """Return the fit of one frame to the positions at rest, or why there is none."""
        seen = self._at_rest[recording]
        nodes = sorted(seen)
        if len(nodes) < LEAST_NODES:
            unknown = f"expected three nodes or more while the robot is at rest, got {len(nodes)}"
            return FrameFit(recording, tuple(nodes), None, unknown=unknown)
        y = np.array([np.median(seen[node], axis=0) for node in nodes])
        x = self._rest.node_position_m[nodes]
        variance_m2 = self._variance_m2(nodes)
        sigma_m = float(np.sqrt(np.trace(variance_m2) / len(variance_m2)))
        beside_m = float(np.linalg.svd(x - x.mean(axis=0))[1][1])
        if sigma_m > MOST_TURN_RAD * beside_m:
            unknown = f"expected nodes that are not on one line at rest, got {', '.join(map(str, nodes))}"
            return FrameFit(recording, tuple(nodes), None, unknown=unknown)
        frame = fitted_frame(x, y, variance_m2, list(self._at_rest).index(recording))
        misfit_m = float(np.sqrt(np.mean((frame.world_m(y) - x) ** 2)))
        if misfit_m > MOST_MISFIT * sigma_m:
            unknown = f"positions at rest fit the rest shape to {1e3 * misfit_m:.1f} mm only: wrong node, unit or axis?"
            return FrameFit(recording, tuple(nodes), None, misfit_m, unknown)
        return FrameFit(recording, tuple(nodes), frame, misfit_m)

    def _variance_m2(self, nodes: Sequence[int]) -> NDArray[np.float64]:
        """Return (3 k, 3 k) V; a reading counts once, for errors of motion capture at rest last."""
        coordinates = (3 * np.array(nodes)[:, None] + np.arange(3)).ravel()
        of_rest = self._rest.covariance_m2[np.ix_(coordinates, coordinates)]
        return np.asarray(of_rest + self._sigma_m**2 * np.eye(len(coordinates)))


def fitted_frame(
    x: NDArray[np.float64], y: NDArray[np.float64], variance_m2: NDArray[np.float64], number: int
) -> OwnFrame:
    """Return the frame in which points of the world have some coordinates, by least squares.

    Args:
        x: (k, 3) in the world; three points or more that are not on one line.
        y: (k, 3) in the frame.
        variance_m2: (3 k, 3 k) covariance of the difference of both.
        number: of the frame.
    """
    pivot_m = x.mean(axis=0)
    turn = best_rotation(x=y - y.mean(axis=0), y=x - pivot_m)
    B = np.zeros((len(x), 3, 6))
    B[:, :, :3] = -cross_matrix(x - pivot_m)
    B[:, :, 3:] = np.eye(3)
    A = np.linalg.pinv(B.reshape(-1, 6))
    return OwnFrame(
        number=number,
        turn=turn,
        origin_m=pivot_m - turn @ y.mean(axis=0),
        pivot_m=pivot_m,
        root=np.linalg.cholesky(A @ variance_m2 @ A.T),
    )
