"""Whether feet that should stand slide, which inertial sensors feel while footholds hold the pose back.

A slow slide of all feet moves the robot by less in one frame than the shape is wrong by, and footholds would hold it
back for ever. Inertial sensors feel it: beside the filter runs a copy without footholds, for up to `WATCH_S`. It begins
without velocity where the robot seems to stand still, as nothing has braked it for `STOPPED_S`: for most of the error
of its place comes from the velocity. With its error e of a foothold and the covariance S of it, the node slides if
e^T S^-1 e is too large. The filter then takes the copy over, and the node has no foothold until it is slow: with the
velocity v, of covariance S_v,

    v^T v < s^2 + tr S_v

or until it has stopped: friction brakes whatever slides, so that a robot which stands has no velocity where inertial
sensors feel for `STOPPED_S` that nothing brakes it. After a blow, which they do not measure, v may be wrong by far.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....factors.ground import velocity_along_floor
from ....models.pose.placed import PlacedShape, Rows
from ....models.pose.pose_state import PoseState
from ....models.structure.floor import Floor
from ....models.values.chi_squared import squared_distance
from ....models.values.slip import Slip
from ....models.values.time_series import low_pass_weight
from ..footholds import Feet, put_down, slips, turned_sigma
from ..pose_model import Pose, PoseModel
from ..prediction import Frame, Prediction, without_heading
from ..tipping import TIPS_RAD_PER_S

WATCH_S = 0.3
"""Time after which the copy starts again: over a longer one, inertial sensors do not tell a slide of millimetres."""
SLIDES_SIGMA = 3.0
"""Distance from its foothold, in standard deviations, from which a node slides if the robot has stood still and does
not tip; else it is that of a slip, as the copy of a robot that tips is less exact."""
LOST_M = 0.005
"""Standard deviation, per axis, of what a robot has slid before the copy started: by less than is found."""
WITH_IT_SIGMA = 2.0
"""Distance from its foothold, in standard deviations, from which a node slides too when another one does."""
REST_M_PER_S = 0.05
"""Speed s below which a foot that slid stands again: friction stops it within a frame or two."""

BRAKES_M_PER_S2 = 0.5
"""Acceleration along the floor of a robot that slides: friction brakes it by several m/s^2."""
STILL_RAD_PER_S = 0.1
"""Rate below which a robot may have stopped."""
STOPPED_S = 0.2
"""Time after which a robot that nothing brakes has stopped, and does not slide on."""
STOPPED_M_PER_S = 0.01
"""Standard deviation of its velocity then, per axis."""
STANDING_M_PER_S = 0.003
"""The same of a robot that has not been seen to slide, and whose feet keep their places in its shape."""
MOVES_SIGMA = 3.0
"""Speed in standard deviations from which a robot is not taken to be still."""


@dataclass(frozen=True, slots=True, eq=False)
class UnheldPose:
    """The estimate of the pose without footholds."""

    since_s: float
    """When it was that of the filter."""
    state: PoseState
    covariance: NDArray[np.float64]
    """(size, size) of its errors."""
    from_rest: bool
    """Whether the robot stood still then, and has not tipped since."""


class SlideWatch:
    """Follows which nodes slide, frame by frame."""

    def __init__(self, model: PoseModel, nodes: int) -> None:
        self._model = model
        self._unheld: UnheldPose | None = None
        self._slid = np.zeros(nodes, dtype=np.bool_)
        self._unbraked_s = 0.0
        self._deforms_m_per_s = np.zeros(3)
        self.since_s = np.full(nodes, np.inf)
        """(nodes,) since when each node that slides has done so at the earliest; inf where it does not."""

    @property
    def slides(self) -> NDArray[np.bool_]:
        """(nodes,) which nodes slide."""
        return np.asarray(np.isfinite(self.since_s))

    def restart(self) -> None:
        """Begin with a new copy: the pose of the filter has changed by more than this one has seen."""
        self._unheld = None

    def lift(self) -> None:
        """Take it as known that no node stands, so that none slides."""
        self.since_s = np.full(len(self.since_s), np.inf)
        self._unheld = None

    def told(self, predicted: Prediction, frame: Frame, before: Pose, sliding: NDArray[np.bool_]) -> Prediction:
        """Take it as known which (nodes,) slide, and return what is then expected of the frame."""
        self._slid = self.slides
        self._feel(predicted, frame, before)
        self.since_s = np.where(sliding, frame.t_s, np.inf)
        return _lost(predicted) if (self.slides & ~self._slid).any() else predicted

    def observe(
        self,
        predicted: Prediction,
        frame: Frame,
        before: Pose,
        stayed: NDArray[np.bool_],
        landed: NDArray[np.bool_],
        used_imus: NDArray[np.bool_],
    ) -> tuple[Prediction, PoseState]:
        """Return what is expected of one more frame, and the state before it: those of the copy where it takes over.

        Args:
            predicted: what is expected of the frame, by the filter.
            frame: the frame.
            before: the pose of the filter in the frame before.
            stayed: (nodes,) which nodes have stood since the frame before.
            landed: (nodes,) which nodes have begun to stand.
            used_imus: (imus,) which inertial sensors are used.
        """
        self._slid = self.slides
        self._feel(predicted, frame, before)
        self._see(frame, stayed)
        model, floor = self._model, self._model.floor
        if self._slid.any():
            slow = have_slowed(predicted.placed, predicted.covariance, floor) | self._has_stopped
            self.since_s = np.where(stayed & ~slow, self.since_s, np.inf)
        if (self._slid & ~self.slides).any():  # their new footholds are those of the next watch
            self._unheld = None
            return predicted, before.state
        if frame.samples is None or frame.t_s < model.rest_until_s:
            return predicted, before.state
        if self._unheld is None or frame.t_s - self._unheld.since_s > WATCH_S:
            self._unheld = self._begun(before, frame)
        unheld, stands = self._unheld, stayed | landed
        free = put_down(_beside(predicted, before, unheld), landed, floor, model.settings.floor_m)
        feet = model.feet(free, stayed & ~self.slides)
        rate_rad_per_s = float(np.linalg.norm(predicted.placed.state.rate_rad_per_s))
        from_rest = unheld.from_rest and rate_rad_per_s < TIPS_RAD_PER_S
        slip_sigma = SLIDES_SIGMA if from_rest else model.settings.slip_sigma
        turns = turned_sigma(feet, free, floor) > slip_sigma
        if turns or slips(feet, free, frame.t_s, floor, slip_sigma):
            slide = slips(feet, free, frame.t_s, floor, 0.0 if turns else WITH_IT_SIGMA)
            self.since_s = self.since_s.copy()
            self.since_s[[slip.node for slip in slide]] = unheld.since_s
            self._unheld = None
            return _lost(free), unheld.state
        state, covariance = model.corrected(free, frame, model.rows(free, frame, stands, used_imus, None))
        self._unheld = UnheldPose(unheld.since_s, state, covariance, from_rest)
        return predicted, before.state

    def stop_rows(self, state: PoseState) -> list[Rows]:
        """Return rows by which a robot that slid, and has stopped, has no velocity; none while it slides or stands."""
        if not (self._has_stopped and self._slid.any()):
            return []
        return [self._velocity_rows(state, STOPPED_M_PER_S)]

    def _velocity_rows(self, state: PoseState, sigma_m_per_s: float) -> Rows:
        """Return rows of no velocity, to within a standard deviation per axis."""
        jacobian = np.zeros((3, state.layout.size))
        jacobian[:, state.layout.velocity] = np.eye(3)
        rows = Rows(-state.velocity_m_per_s, jacobian, np.full(3, sigma_m_per_s**2))
        return without_heading(rows, state, self._model.floor)

    @property
    def _has_stopped(self) -> bool:
        return self._unbraked_s > STOPPED_S

    def _feel(self, predicted: Prediction, frame: Frame, before: Pose) -> None:
        """Learn for how long inertial sensors have felt that nothing brakes the robot."""
        state = predicted.placed.state
        gained_m_per_s = self._model.floor.axes @ (state.velocity_m_per_s - before.state.velocity_m_per_s)
        is_braked = float(np.linalg.norm(gained_m_per_s)) > BRAKES_M_PER_S2 * frame.step_s
        turns = float(np.linalg.norm(state.rate_rad_per_s)) > STILL_RAD_PER_S
        self._unbraked_s = self._unbraked_s + frame.step_s if frame.is_felt and not (is_braked or turns) else 0.0

    def _see(self, frame: Frame, stayed: NDArray[np.bool_]) -> None:
        """Learn how fast the feet move in the body, because the structure deforms."""
        moved_m = (frame.body_m - frame.body_before_m)[stayed].mean(axis=0) if stayed.any() else np.zeros(3)
        weight = low_pass_weight(frame.step_s, STOPPED_S)
        self._deforms_m_per_s = self._deforms_m_per_s + weight * (moved_m / frame.step_s - self._deforms_m_per_s)

    def _begun(self, pose: Pose, frame: Frame) -> UnheldPose:
        """Return a new copy of the pose of the frame before, without velocity if the robot seems to stand still."""
        state, at = pose.state, pose.state.layout
        sigma = STANDING_M_PER_S + float(np.linalg.norm(self._deforms_m_per_s))
        v, S = state.velocity_m_per_s, pose.covariance[at.velocity, at.velocity] + sigma**2 * np.eye(3)
        if not self._has_stopped or squared_distance(v, S) > MOVES_SIGMA**2:
            return UnheldPose(frame.before_s, state, pose.covariance, from_rest=False)
        placed = PlacedShape(state, frame.body_before_m, frame.body_covariance_m2)
        rows = self._velocity_rows(state, sigma)
        given = Prediction(placed, np.eye(at.size), pose.covariance, np.zeros(3)).given(rows)
        return UnheldPose(frame.before_s, given.placed.state, given.covariance, from_rest=True)

    def slips(self, predicted: Prediction, standing_feet: Feet, t_s: float) -> list[Slip]:
        """Return the slips of nodes that stand: those found at once, and the slides that have ended.

        Args:
            predicted: what is expected of the frame.
            standing_feet: the nodes that have stood since the frame before.
            t_s: time of the frame.
        """
        floor, stand = self._model.floor, ~self.slides
        slip_sigma = self._model.settings.slip_sigma
        at_once = slips(standing_feet.among(stand & ~self._slid), predicted, t_s, floor, slip_sigma)
        return at_once + slips(standing_feet.among(stand & self._slid), predicted, t_s, floor, 0.0)


def _beside(predicted: Prediction, before: Pose, unheld: UnheldPose) -> Prediction:
    """Return what is expected of the copy: it moves as the filter does.

    The errors d from the filter to the copy, and the difference of their covariances, follow the transition F:

        d <- F d,     P_c <- P + F (P_c - P) F^T

    Args:
        predicted: what is expected of the frame, by the filter.
        before: the pose of the filter in the frame before.
        unheld: the copy in that frame.
    """
    F, placed = predicted.transition, predicted.placed
    state = placed.state.moved(F @ before.state.errors_to(unheld.state))
    covariance = predicted.covariance + F @ (unheld.covariance - before.covariance) @ F.T
    return Prediction(placed.at(state), F, covariance, predicted.turned)


def _lost(predicted: Prediction) -> Prediction:
    """Return the prediction with what a robot that begins to slide has slid unseen."""
    at = predicted.placed.state.layout
    variance = np.zeros(at.size)
    variance[at.position] = LOST_M**2
    return predicted.then(predicted.placed, np.eye(at.size), variance)


def have_slowed(placed: PlacedShape, covariance: NDArray[np.float64], floor: Floor) -> NDArray[np.bool_]:
    """Return (nodes,) which nodes may be at rest along the floor, by the velocity of the body.

    Args:
        placed: the shape in the world.
        covariance: (size, size) of the errors of its state.
        floor: the floor.
    """
    v, jacobian = velocity_along_floor(placed, floor.axes)
    variance = np.einsum("kai,ij,kaj->k", jacobian, covariance, jacobian)
    return np.asarray(np.sum(v**2, axis=1) < REST_M_PER_S**2 + variance)


def slid_before(since_s: NDArray[np.float64], t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (frames, nodes) which nodes slide in each frame, given the slides that later frames have found.

    Args:
        since_s: (frames, nodes) since when a node slides, see `PoseStep.slides_since_s`.
        t_s: (frames,) time of each frame.
    """
    slides = np.zeros(since_s.shape, dtype=np.bool_)
    for k, node in np.argwhere(np.isfinite(since_s)):
        slides[np.searchsorted(t_s, since_s[k, node], side="right") : k + 1, node] = True
    return slides
