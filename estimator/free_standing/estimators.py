"""A free-standing structure: its shape, where it is, and which of its nodes the floor carries.

The shape is estimated in body coordinates by the estimators of anchored structures. Lengths and balance need no base,
but the balance needs the direction of gravity and the forces of the floor, which the pose gives; the pose in turn needs
the shape. Live both take turns, each with the other's newest estimate. In batch the poses of the live pass, smoothed,
give the support of each frame for the optimisation of all shapes, and these shapes give the poses.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from ...models.pose.pose_state import PoseState
from ...models.pose.robot import FreeStandingRobot
from ...models.settings import Settings
from ...models.structure.floor import Floor
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Reason, Shape
from ...models.structure.structure import Structure
from ...models.values.aids import AidReading, PositionReading
from ...models.values.readings import TendonLengths
from ..batch import BatchOptimizer, without_lag
from ..smoother import LiveSmoother
from .contacts import Standing, nothing_stands
from .imu_trust import without_sensors
from .length_change import LengthChange
from .pose_filter import PoseFilter
from .pose_smoother import PoseStep, smoothed
from .resting_faces import RestingFaces, balances_at
from .stable_face import StableFace
from .tipping import TIPS_RAD_PER_S
from .watches.measured_attitude import MeasuredAttitude, are_parallel
from .watches.slide_watch import slid_before
from .world import in_world, support_of

FACES_EVERY_S = 0.2
"""Shortest time between two looks at the faces, each of which takes longer than all else in a frame."""
LOOK_S = 0.06
"""Time over whose frames a look is spread, live: what it finds is told this much later at most."""
LOOK_PARTS = 3
"""Number of parts of a look, one for each frame at 50 Hz."""

LEAST_LIKELY = 0.02
"""Probability of the face on which the robot stands by heights, below which forces contradict it."""
CERTAIN_FACE = 0.95
"""Probability of a face in each of `SURE_LOOKS`, from which inertial sensors are turned as the robot stands on it."""
SURE_LOOKS = 3
"""Number of looks in succession."""
SURE_FACE = 0.8
"""Probability of a face that the balance of forces tells, above which it may contradict heights."""
CONTRADICTS_S = 0.8
"""Time for which it has to."""
LIKELY_TIP = 0.5
"""Least `LengthChange.may_have_tipped` of a tip."""


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """What the live pass has learned of one frame, as the batch estimate needs it."""

    standing: Standing
    by_faces: bool
    """Whether faces told which nodes stand, by the balance of forces or by the shape alone."""
    faces: NDArray[np.float64] | None
    """(states,) probabilities of `RestingFaces`, after an update of them."""
    may_tip: float
    """Whether lengths changed as if the structure tipped, see `LengthChange.may_have_tipped`."""
    contradicted_positions: tuple[int, ...]
    """The nodes of positions that were left out."""
    measured_up: NDArray[np.float64] | None
    """(3,) the floor's normal in body axes, while sensors tell how the structure is turned; None while they do not."""
    doubts_positions: bool
    """See `PoseFilter.doubts_positions`."""


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


class FreeStandingSmoother:
    """Estimates shape, pose and contacts in the newest frame from this and all earlier frames."""

    def __init__(self, structure: Structure, rest: RestShape, robot: FreeStandingRobot, settings: Settings) -> None:
        self._structure = structure
        self._rest = rest
        self._robot = robot
        self._settings = settings
        self.shapes = LiveSmoother(structure, rest, settings)
        self._poses = PoseFilter(rest, robot, settings.pose)
        self._faces = resting_faces(structure, rest, robot, settings)
        self._stable = StableFace(robot.floor) if self._faces is None else None
        self._change = LengthChange(robot.rest_seconds)
        self._may_tip = 0.0
        self._measured = MeasuredAttitude()
        self._agreed_s = -np.inf
        self._tipped_s = -np.inf
        self._looked_s = -np.inf
        self._look: _Look | None = None
        self._sure_looks = 0
        self._last_m = rest.node_position_m
        self._last_s = -np.inf
        self._stand_on(self._poses.state, self._poses.covariance, self._poses.standing)
        self.kept: list[_Kept] | None = None
        """What was learned in each frame, for a smoother that puts a list here; live, memory is bounded."""

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape in the world for each frame, as soon as the frame arrives."""
        for lengths in frames:
            shape, step = self.update(lengths)
            shape = self.shapes.now(shape)
            yield in_world(
                shape, self._rest, self._robot.floor, step.state, step.covariance, step, self._settings.branch
            )

    def update(self, lengths: TendonLengths) -> tuple[Shape, PoseStep]:
        """Return the shape in one more frame, in body coordinates, and its pose."""
        shape = self._poses.without_contradictions(self.shapes.update(lengths))
        lengths = shape.lengths
        self._change.observe(shape.lengths)
        used = self._poses.used_imus
        measured = self._measured.observe(lengths, used)
        rods = self._structure.rods[[self._robot.imus[i].rod for i in np.flatnonzero(used)]]
        one_direction = are_parallel(np.concatenate([rods, self._measured.located_pairs]), self._rest)
        looked = (not measured or one_direction) and self._looks(shape)
        stands = self._stands_by_shape(shape, measured=measured, one_direction=one_direction)
        self._sure_looks = self._sure_looks_after(looked=looked) if not measured else 0
        at_rest = shape.t_s < self._robot.rest_until_s
        self._poses.knows_attitude = measured or at_rest or self._faces is None or self._sure_looks >= SURE_LOOKS
        step = self._poses.step(lengths.t_s, shape.node_position_m, shape.covariance_m2, lengths.aids, stands)
        if measured and one_direction:
            step = self._with_doubt(step, tips_unseen=not used.any() and self._tips_unseen(step))
        elif measured:
            self._turn_faces(step.standing)
        measured_up = step.state.turn.T @ self._poses.floor.normal if measured else None
        if measured_up is not None and self._stable:
            self._stable.turned_to(measured_up)
        self._last_m, self._last_s = shape.node_position_m, shape.t_s
        self._stand_on(step.state, step.covariance, step.standing)
        if self.kept is not None:
            probability = self._faces.probability if self._faces and looked else None
            left_out, doubts = shape.contradicted_positions, self._poses.doubts_positions
            by_faces = stands is not None
            self.kept.append(_Kept(step.standing, by_faces, probability, self._may_tip, left_out, measured_up, doubts))
        return shape, step

    def _stands_by_shape(self, shape: Shape, *, measured: bool, one_direction: bool) -> Standing | None:
        """Return on which nodes the robot stands by forces or by its shape alone; None where its attitude tells it.

        Args:
            shape: the newest one.
            measured: whether other sensors measure how the robot is turned.
            one_direction: whether they do so but for the turn about one direction.
        """
        if self._stable and not measured and shape.t_s >= self._robot.rest_until_s:
            return self._stable.observe(shape)
        if self._faces and (not measured or (one_direction and self._contradicts(shape.t_s))):
            return self._faces.standing
        return None

    def _sure_looks_after(self, *, looked: bool) -> int:
        """Return in how many looks in succession forces have told one face.

        An inertial sensor that is heard again is turned with the robot. On a wrong face it would tell that face from
        then on, as long as its rod is inclined alike there.
        """
        if self._faces is None or not looked:
            return self._sure_looks
        return self._sure_looks + 1 if self._faces.probability.max() > CERTAIN_FACE else 0

    def _turn_faces(self, standing: Standing) -> None:
        """Take over on which nodes the robot stands, as its measured attitude tells it."""
        if self._faces is not None:
            self._tipped_s = -np.inf
            self._faces.stand_on(standing.nodes)
            self._look = None

    @property
    def contradicted_imus(self) -> NDArray[np.bool_]:
        """(imus,) see `ImuTrust.contradicted`."""
        return self._poses.contradicted_imus

    def _with_doubt(self, step: PoseStep, *, tips_unseen: bool) -> PoseStep:
        """Return the step with the faces that forces tell beside its own, if they do not tell its own.

        Args:
            step: the step.
            tips_unseen: whether the structure may tip about a line of which positions alone are read.
        """
        if self._faces is None:
            return step
        told = self._faces.standing
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
            self._tipped_s = self._last_s
        has_looked = self._looked_s > self._tipped_s and self._look is None
        if has_looked and self._faces.standing.probability_of(step.standing.nodes) > SURE_FACE:
            self._tipped_s = -np.inf
        return self._tipped_s > -np.inf

    def _contradicts(self, t_s: float) -> bool:
        """Return whether the balance of forces has told another face than heights for some time.

        Inertial sensors on parallel rods do not tell the turn about these rods, nor do positions on one line that about
        the line, so that heights may be wrong.
        """
        if self._faces is None:
            return False
        stands = self._faces.standing
        sure = self._faces.probability.max() > SURE_FACE and stands.nodes.sum() > 2
        if not sure or np.array_equal(stands.nodes, self._poses.standing.nodes):
            self._agreed_s = t_s
        return t_s - self._agreed_s > CONTRADICTS_S

    def _looks(self, shape: Shape) -> bool:
        """Look at the faces for one more frame, if the balance of forces tells them; return whether a look has ended.

        Live each frame does the parts that are due before the next one; for a smoother, the first frame does all.
        """
        if self._faces is None:
            return False
        if self._look is None and shape.t_s - self._looked_s >= 0.999 * FACES_EVERY_S:
            self._look = self._begun(self._faces, shape)
        if self._look is None:
            return False
        look = self._look
        done_by_next = (2 * shape.t_s - self._last_s - look.t_s) / LOOK_S
        due = LOOK_PARTS if self.kept is not None else math.ceil(min(done_by_next, 1.0) * LOOK_PARTS - 1e-6)
        look.found.extend(islice(look.parts, max(due - len(look.found), 0)))
        if len(look.found) < LOOK_PARTS:
            return False
        self._look, self._may_tip = None, look.may_tip
        self._faces.predict(look.step_s, look.may_tip)
        self._faces.update(np.concatenate(look.found), look.of_heights, look.step_s, look.may_tip)
        return True

    def _begun(self, faces: RestingFaces, shape: Shape) -> _Look | None:
        """Return a new look at the faces; None where the balance of forces does not tell them."""
        frame, statics = self.shapes.linear, self.shapes.builder.statics
        if frame is None or statics is None:
            return None
        step_s = min(shape.t_s - self._looked_s, 1.0)
        self._looked_s = shape.t_s
        x = shape.node_position_m
        balances = balances_at(x, frame, statics, self.shapes.builder, self._settings.doubt.quiet_n)
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

    def _stand_on(self, state: PoseState, covariance: NDArray[np.float64], stands: Standing) -> None:
        if self._rest.mechanics is not None:
            probability = stands.probability
            support = support_of(self._structure, self._rest, self._last_m, state, covariance, probability)
            self.shapes.builder.stand_on(support)


class FreeStandingOptimizer:
    """Estimates shape, pose and contacts in every frame from all frames of the trial, earlier and later ones."""

    def __init__(self, structure: Structure, rest: RestShape, robot: FreeStandingRobot, settings: Settings) -> None:
        self._structure = structure
        self._rest = rest
        self._robot = robot
        self._settings = settings

    def estimate(
        self, frames: Iterable[TendonLengths], progress: Callable[[int, float], None] = lambda iteration, error: None
    ) -> Iterator[Shape]:
        """Yield a shape in the world for each frame, after all frames have been read.

        Args:
            frames: lengths, in order of time.
            progress: see `BatchOptimizer.estimate`.

        Raises:
            IndeterminateError: when measurements and priors leave some node undetermined.
        """
        frames = without_lag(list(frames))
        live, shapes, steps = self._live(frames)
        contradicted = live.contradicted_imus
        if contradicted.any():  # what they told before they were found out is wrong, too
            frames = without_sensors(frames, contradicted)
            live, shapes, steps = self._live(frames)
        frames = [replace(lengths, aids=shape.lengths.aids) for lengths, shape in zip(frames, shapes, strict=True)]
        contacts = self._contacts(live, frames, shapes)
        if any(standing is not None for standing in contacts):
            steps = self._filtered(frames, shapes, contacts)
        poses = self._poses(frames, shapes, contacts, steps)
        supports = [
            support_of(self._structure, self._rest, shape.node_position_m, state, covariance, step.standing.probability)
            for shape, (state, covariance, step) in zip(shapes, poses, strict=True)
        ]
        shapes = [shape.without_covariance() for shape in shapes]
        del poses, steps  # their covariances are large
        optimizer = BatchOptimizer(self._structure, self._rest, self._settings)
        shapes = list(optimizer.refined(frames, live.shapes, shapes, supports, progress))
        contacts = self._contacts(live, frames, shapes)
        poses = self._poses(frames, shapes, contacts, self._filtered(frames, shapes, contacts))
        assert live.kept is not None, "the live pass keeps what it learns"
        doubts_ranges = poses[-1][2].doubts_ranges  # those of before may be wrong, too
        for shape, (state, covariance, step), kept in zip(shapes, poses, live.kept, strict=True):
            if kept.standing.contradicted:
                standing = replace(step.standing, others=kept.standing.others, contradicted=True)
                step = replace(step, standing=standing)
            shape = replace(shape, contradicted_positions=kept.contradicted_positions)
            if kept.doubts_positions:
                shape = shape.in_doubt(Reason.POSITIONS)
            contradicted_imus = step.contradicted_imus | contradicted
            step = replace(step, contradicted_imus=contradicted_imus, doubts_ranges=doubts_ranges)
            yield in_world(shape, self._rest, self._robot.floor, state, covariance, step, self._settings.branch)

    def _live(self, frames: Sequence[TendonLengths]) -> tuple[FreeStandingSmoother, list[Shape], list[PoseStep]]:
        """Return the live estimator after all frames, with what it has kept of them, its shapes and their poses."""
        live = FreeStandingSmoother(self._structure, self._rest, self._robot, self._settings)
        live.shapes.keep()
        live.kept = []
        estimates = [live.update(lengths) for lengths in frames]
        return live, [shape for shape, _ in estimates], [step for _, step in estimates]

    def _contacts(
        self, live: FreeStandingSmoother, frames: Sequence[TendonLengths], shapes: Sequence[Shape]
    ) -> list[Standing | None]:
        """Return which nodes stand in each frame by the faces of the whole trial; None where heights tell it."""
        assert live.kept is not None, "the live pass keeps what it learns"
        kept = live.kept
        faces = resting_faces(self._structure, self._rest, self._robot, self._settings)
        if faces is None:
            return self._contacts_by_shape(kept, shapes)
        contacts: list[Standing | None] = [None] * len(frames)
        looked = [k for k, one in enumerate(kept) if one.faces is not None]
        if not looked:
            return contacts
        # in each stretch in which faces were looked at, those of the whole stretch; heights tell it elsewhere
        for stretch in _stretches(looked, [lengths.t_s for lengths in frames]):
            may_tip = np.array([kept[k].may_tip for k in stretch])
            smoothed_faces = faces.smoothed(FACES_EVERY_S, np.array([kept[k].faces for k in stretch]), may_tip)
            end = stretch[-1] + 1
            while end < len(frames) and kept[end].by_faces:
                end += 1
            for k in range(stretch[0], end):
                nearest = np.argmin(np.abs(np.array(stretch) - k))
                contacts[k] = smoothed_faces[int(nearest)] if kept[k].by_faces else None
        return contacts

    def _contacts_by_shape(self, kept: Sequence[_Kept], shapes: Sequence[Shape]) -> list[Standing | None]:
        """Return which nodes stand by the shape alone, where neither sensors nor forces tell it; None elsewhere."""
        stable = StableFace(self._robot.floor)
        contacts: list[Standing | None] = []
        for shape, one in zip(shapes, kept, strict=True):
            if one.measured_up is not None:
                stable.turned_to(one.measured_up)
                contacts.append(None)
                continue
            stands = stable.observe(shape)
            contacts.append(stands if one.by_faces else None)
        return contacts

    def _poses(
        self,
        frames: Sequence[TendonLengths],
        shapes: Sequence[Shape],
        contacts: Sequence[Standing | None],
        steps: Sequence[PoseStep],
    ) -> list[tuple[PoseState, NDArray[np.float64], PoseStep]]:
        """Return the state of the pose, its covariance and the filter's step in each frame, from the filter's steps.

        Where feet slide, or the robot is lifted, which is found some time after it began, the filter runs again and
        knows it from the start.
        """
        t_s = np.array([lengths.t_s for lengths in frames])
        slides_s = np.array([step.slides_since_s for step in steps])
        lifted_s = np.array([[step.lifted_since_s] for step in steps])
        if np.isfinite(slides_s).any() or np.isfinite(lifted_s).any():
            lifted = slid_before(lifted_s, t_s)[:, 0]
            in_the_air = nothing_stands(self._structure.node_count)
            contacts = [in_the_air if up else told for up, told in zip(lifted, contacts, strict=True)]
            steps = self._filtered(frames, shapes, contacts, slid_before(slides_s, t_s))
        return [(state, covariance, step) for (state, covariance), step in zip(smoothed(steps), steps, strict=True)]

    def _filtered(
        self,
        frames: Sequence[TendonLengths],
        shapes: Sequence[Shape],
        contacts: Sequence[Standing | None],
        sliding: NDArray[np.bool_] | None = None,
    ) -> list[PoseStep]:
        """Return the filter's steps over all frames; (frames, nodes) tell which nodes slide, None to tell it itself."""
        poses = PoseFilter(self._rest, self._robot, self._settings.pose)
        told = [None] * len(frames) if sliding is None else sliding
        return [
            poses.step(lengths.t_s, shape.node_position_m, shape.covariance_m2, lengths.aids, stands, slides)
            for lengths, shape, stands, slides in zip(frames, shapes, contacts, told, strict=True)
        ]


def _stretches(looked: Sequence[int], t_s: Sequence[float]) -> list[list[int]]:
    """Return the numbers of frames in lists, each without a hole of two looks."""
    stretches: list[list[int]] = []
    for k in looked:
        if stretches and t_s[k] - t_s[stretches[-1][-1]] < 2 * FACES_EVERY_S:
            stretches[-1].append(k)
        else:
            stretches.append([k])
    return stretches


def resting_faces(
    structure: Structure, rest: RestShape, robot: FreeStandingRobot, settings: Settings
) -> RestingFaces | None:
    """Return the filter of faces; None where forces are unknown."""
    if rest.mechanics is None or not (mass_kg := rest.mechanics.node_mass_kg(structure)).any():
        return None
    stands = robot.floor.carries_at_rest(rest.node_position_m)
    return RestingFaces(mass_kg, rest.node_position_m, stands, settings.doubt)


def clearances(aids: Sequence[AidReading], floor: Floor) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return (known,) nodes with measured positions, and (known,) their heights above a node that stands.

    There are none where the floor's normal is estimated: far from the start, its height is wrong by decimetres.
    """
    positions = [] if floor.tilt_count else [reading for reading in aids if isinstance(reading, PositionReading)]
    measured = {reading.node: reading.position_m for reading in positions}
    return np.array(list(measured), dtype=np.int64), floor.clearance_m(np.array(list(measured.values())).reshape(-1, 3))
