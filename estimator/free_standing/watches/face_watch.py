"""On which face the robot stands, as far as no sensor measures how it is turned.

The balance of forces tells it, see `resting_faces`, in looks at the faces of which each takes longer than all else in a
frame; where forces are unknown, the shape alone does, see `stable_face`. Where sensors measure how the robot is turned,
heights tell it, and the faces follow; where they do so but for the turn about one direction, forces may contradict.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from ....models.pose.robot import FreeStandingRobot
from ....models.settings import Settings
from ....models.structure.floor import Floor
from ....models.structure.rest_shape import RestShape
from ....models.structure.shape import Shape
from ....models.values.aids import AidReading, PositionReading
from ....models.values.stamps import is_due
from ...smoother import LiveSmoother
from ..contacts import Standing
from ..length_change import LengthChange
from ..pose_filter import PoseFilter
from ..pose_smoother import PoseStep
from ..resting_faces import RestingFaces, balances_at, resting_faces
from ..stable_face import StableFace
from ..tipping import TIPS_RAD_PER_S
from .measured_attitude import Attitude, MeasuredAttitude

FACES_EVERY_S = 0.2
"""Shortest time between two looks at the faces, each of which takes longer than all else in a frame."""
LOOK_S = 0.06
"""Time over whose frames a look is spread, live: what it finds is told this much later at most."""
LOOK_PARTS = 3
"""Number of parts of a look, one for each frame at 50 Hz."""

LEAST_LIKELY = 0.02
"""Probability of the face on which the robot stands by heights, below which forces contradict it."""
CERTAIN_FACE = 0.95
"""Probability of a face, with those of leaning over one of its edges, in each of `SURE_LOOKS`, from which inertial
sensors are turned as the robot stands on it."""
SURE_LOOKS = 3
"""Number of looks in succession."""
SURE_FACE = 0.8
"""Probability of a face that the balance of forces tells, above which it may contradict heights."""
CONTRADICTS_S = 0.8
"""Time for which it has to."""
LIKELY_TIP = 0.5
"""Least `LengthChange.may_have_tipped` of a tip."""


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """A look at the faces in one frame, which goes on in the frames after it."""

    t_s: float
    """Time of the frame."""
    step_s: float
    """Time since the look before, of a second at most."""
    may_tip: float
    """See `LengthChange.may_have_tipped`."""
    of_heights: NDArray[np.float64]
    """(faces + edges,) the log evidence of known heights."""
    parts: Iterator[NDArray[np.float64]]
    """The log evidence of the balance of forces, see `RestingFaces.log_evidence_in_parts`."""
    found: list[NDArray[np.float64]]
    """The parts of it that have been computed."""


class FaceWatch:
    """Follows on which face the robot stands, frame by frame."""

    def __init__(
        self, rest: RestShape, robot: FreeStandingRobot, poses: PoseFilter, shapes: LiveSmoother, settings: Settings
    ) -> None:
        """Begin at rest.

        Args:
            rest: the rest shape.
            robot: the robot.
            poses: the filter of its pose, of which the newest estimate is used.
            shapes: the estimator of its shape, of which the newest factors are used.
            settings: those of the doubt are used.
        """
        self._rest_until_s = robot.rest_until_s
        self._poses = poses
        self._shapes = shapes
        self._settings = settings.doubt
        self._faces = resting_faces(rest, robot, settings.doubt)
        self._stable = StableFace(robot.floor) if self._faces is None else None
        self._change = LengthChange(robot.rest_seconds)
        self._measured = MeasuredAttitude(rest, robot)
        self._attitude = Attitude.UNKNOWN
        self._is_felt = False
        self._before_s = self._t_s = -np.inf
        self._agreed_s = -np.inf
        self._tipped_s = -np.inf
        self._looked_s = -np.inf
        self._look: _Look | None = None
        self._sure_looks = 0
        self.may_tip = 0.0
        """See `LengthChange.may_have_tipped`, at the newest look."""
        self.found: NDArray[np.float64] | None = None
        """(states,) probabilities of `RestingFaces`, if a look has ended in the newest frame."""

    def observe(self, shape: Shape, *, at_once: bool) -> Standing | None:
        """Return on which nodes the robot stands in one more frame, before its pose; None where heights tell it.

        Args:
            shape: in body coordinates.
            at_once: whether a look is done in one frame, and not spread over several.
        """
        self._before_s, self._t_s = self._t_s, shape.t_s
        self._change.observe(shape.lengths)
        used = self._poses.trust.is_used
        self._attitude = attitude = self._measured.observe(shape.lengths, used)
        self._is_felt = bool(used.any())
        looked = attitude is not Attitude.KNOWN and self._looks(shape, at_once=at_once)
        self.found = self._faces.probability if self._faces and looked else None
        self._sure_looks = self._sure_looks_after(looked=looked) if attitude is Attitude.UNKNOWN else 0
        if attitude is Attitude.UNKNOWN and self._stable and shape.t_s >= self._rest_until_s:
            return self._stable.observe(shape)
        if self._faces and (
            attitude is Attitude.UNKNOWN or (attitude is Attitude.KNOWN_BUT_ONE_TURN and self._contradicts())
        ):
            return self._faces.standing
        return None

    @property
    def knows_attitude(self) -> bool:
        """Whether it is known how the robot is turned, so that a sensor that is heard again may be turned with it.

        On a wrong face it would tell that face from then on, as long as its rod is inclined alike there.
        """
        is_told = self._attitude is not Attitude.UNKNOWN or self._t_s < self._rest_until_s
        return is_told or self._faces is None or self._sure_looks >= SURE_LOOKS

    def judged(self, step: PoseStep) -> PoseStep:
        """Return the step of the pose in the same frame, with the faces that forces tell where these are others."""
        if self._attitude is Attitude.KNOWN_BUT_ONE_TURN:
            step = self._with_doubt(step)
        elif self._attitude is Attitude.KNOWN and self._faces is not None:
            self._tipped_s = -np.inf
            self._faces.stand_on(step.standing.nodes)
            self._look = None
        elif self._poses.lost_robot and not self.knows_attitude:
            step = replace(step, standing=replace(step.standing, contradicted=True))
        up = self.measured_up(step)
        if up is not None and self._stable:
            self._stable.turned_to(up)
        return step

    def measured_up(self, step: PoseStep) -> NDArray[np.float64] | None:
        """Return (3,) the floor's normal in body axes; None where sensors do not tell how the robot is turned."""
        if self._attitude is Attitude.UNKNOWN:
            return None
        return np.asarray(step.state.turn.T @ self._poses.floor.normal)

    def _sure_looks_after(self, *, looked: bool) -> int:
        """Return in how many looks in succession forces have told one face."""
        if self._faces is None or not looked:
            return self._sure_looks
        sure = _tells_a_face(self._faces) and self._faces.probability_with_leaning > CERTAIN_FACE
        return self._sure_looks + 1 if sure else 0

    def _with_doubt(self, step: PoseStep) -> PoseStep:
        """Return the step with the faces that forces tell beside its own, if they do not tell its own."""
        if self._faces is None:
            return step
        told = self._faces.standing
        tips_unseen = not self._is_felt and self._tips_unseen(step)
        if told.probability_of(step.standing.nodes) > LEAST_LIKELY and not tips_unseen:
            return step
        others = (*told.others, (float(self._faces.probability.max()), told.nodes))
        return replace(step, standing=replace(step.standing, others=others, contradicted=True))

    def _tips_unseen(self, step: PoseStep) -> bool:
        """Return whether it tips, or has tipped, and forces have not told since then on which face it stands.

        Positions on one line do not tell the turn about the line, and none at all of a tip over an edge on that line.
        """
        if self._faces is None:
            return False
        turns = float(np.linalg.norm(step.state.rate_rad_per_s)) > TIPS_RAD_PER_S
        is_edge = bool(step.standing.nodes[self._measured.located_pairs].all())
        if (turns or is_edge) and self._change.may_have_tipped() > LIKELY_TIP:
            self._tipped_s = self._before_s
        has_looked = self._looked_s > self._tipped_s and self._look is None
        if has_looked and self._faces.standing.probability_of(step.standing.nodes) > SURE_FACE:
            self._tipped_s = -np.inf
        return self._tipped_s > -np.inf

    def _contradicts(self) -> bool:
        """Return whether the balance of forces has told another face than heights for some time.

        Inertial sensors on parallel rods do not tell the turn about these rods, nor do positions on one line that about
        the line, so that heights may be wrong.
        """
        if self._faces is None:
            return False
        agrees = np.array_equal(self._faces.standing.nodes, self._poses.standing.nodes)
        if agrees or not _tells_a_face(self._faces):
            self._agreed_s = self._t_s
        return self._t_s - self._agreed_s > CONTRADICTS_S

    def _looks(self, shape: Shape, *, at_once: bool) -> bool:
        """Look at the faces for one more frame, if the balance of forces tells them; return whether a look has ended.

        Each frame does the parts that are due before the next one, or the first frame does all at once.
        """
        if self._faces is None:
            return False
        if self._look is None and is_due(shape.t_s - self._looked_s, FACES_EVERY_S):
            self._look = self._begun(self._faces, shape)
        if self._look is None:
            return False
        look = self._look
        done_by_next = (2 * shape.t_s - self._before_s - look.t_s) / LOOK_S
        due = LOOK_PARTS if at_once else math.ceil(min(done_by_next, 1.0) * LOOK_PARTS - 1e-6)
        look.found.extend(islice(look.parts, max(due - len(look.found), 0)))
        if len(look.found) < LOOK_PARTS:
            return False
        self._look, self.may_tip = None, look.may_tip
        self._faces.update(np.concatenate(look.found), look.of_heights, look.step_s, look.may_tip)
        return True

    def _begun(self, faces: RestingFaces, shape: Shape) -> _Look | None:
        """Return a new look at the faces; None where the balance of forces does not tell them."""
        frame, builder = self._shapes.linear, self._shapes.builder
        if frame is None or builder.statics is None:
            return None
        step_s = min(shape.t_s - self._looked_s, 1.0)
        self._looked_s = shape.t_s
        x = shape.node_position_m
        balances = balances_at(x, frame, builder, self._settings.quiet_n)
        nodes, clearance_m = clearances(shape.lengths.aids, self._poses.floor)
        rods, rod_height_m = self._poses.rod_heights()
        of_heights = faces.log_evidence_of_clearances(x, nodes, clearance_m)
        return _Look(
            t_s=shape.t_s,
            step_s=step_s,
            may_tip=self._change.may_have_tipped(),
            of_heights=of_heights + faces.log_evidence_of_heights(x, rods, rod_height_m),
            parts=faces.log_evidence_in_parts(balances, x, LOOK_PARTS),
            found=[],
        )


def _tells_a_face(faces: RestingFaces) -> bool:
    """Return whether the balance of forces tells a face, and no tip over an edge."""
    return float(faces.probability.max()) > SURE_FACE and int(faces.standing.nodes.sum()) > 2


def clearances(aids: Sequence[AidReading], floor: Floor) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return (known,) nodes with measured positions, and (known,) their heights above a node that stands.

    There are none where the floor's normal is estimated: far from the start, its height is wrong by decimetres.
    """
    positions = [] if floor.tilt_count else [reading for reading in aids if isinstance(reading, PositionReading)]
    measured = {reading.node: reading.position_m for reading in positions}
    return np.array(list(measured), dtype=np.int64), floor.clearance_m(np.array(list(measured.values())).reshape(-1, 3))
