"""A free-standing structure: its shape, where it is, and which of its nodes the floor carries.

The shape is estimated in body coordinates by the estimators of anchored structures. Lengths and balance need no base,
but the balance needs the direction of gravity and the forces of the floor, which the pose gives; the pose in turn needs
the shape. Live both take turns, each with the other's newest estimate. In batch the poses of the live pass, smoothed,
give the support of each frame for the optimisation of all shapes, and these shapes give the poses.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...models.balance.support import Support
from ...models.pose.pose_state import PoseState
from ...models.pose.robot import FreeStandingRobot
from ...models.settings import Settings
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Reason, Shape
from ...models.values.readings import TendonLengths
from ..batch import BatchOptimizer, without_lag
from ..smoother import LiveSmoother
from ..whole_trial.trial_chain import Progress, no_progress
from .contacts import Standing, nothing_stands
from .imu_trust import without_sensors
from .pose_filter import PoseFilter
from .pose_smoother import PoseStep, contradiction, smoothed_poses
from .resting_faces import resting_faces
from .stable_face import StableFace
from .watches.face_watch import FACES_EVERY_S, FaceWatch
from .watches.slide_watch import slid_before
from .world import in_world, support_of


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


class FreeStandingSmoother:
    """Estimates shape, pose and contacts in the newest frame from this and all earlier frames."""

    def __init__(self, rest: RestShape, robot: FreeStandingRobot, settings: Settings) -> None:
        self._rest = rest
        self._robot = robot
        self._settings = settings
        self.shapes = LiveSmoother(rest.structure, rest, settings)
        self._poses = PoseFilter(rest, robot, settings.pose)
        self._faces = FaceWatch(rest, robot, self._poses, self.shapes, settings)
        self._last_m = rest.node_position_m
        self._is_lifted = False
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
        stands = self._faces.observe(shape, at_once=self.kept is not None)
        self._poses.knows_attitude = self._faces.knows_attitude
        x, aids = shape.node_position_m, shape.lengths.aids
        step = self._faces.judged(self._poses.step(shape.t_s, x, shape.covariance_m2, aids, stands))
        self._last_m = x
        self._stand_on(step.state, step.covariance, step.standing)
        was_lifted, self._is_lifted = self._is_lifted, bool(np.isfinite(step.lifted_since_s))
        if self._is_lifted and not was_lifted:
            self.shapes.doubt.forget_loads()
        if self.kept is not None:
            kept = _Kept(
                standing=step.standing,
                by_faces=stands is not None,
                faces=self._faces.found,
                may_tip=self._faces.may_tip,
                contradicted_positions=shape.contradicted_positions,
                measured_up=self._faces.measured_up(step),
                doubts_positions=self._poses.doubts_positions,
            )
            self.kept.append(kept)
        return shape, step

    def _stand_on(self, state: PoseState, covariance: NDArray[np.float64], stands: Standing) -> None:
        if self._rest.mechanics is not None:
            support = support_of(self._rest, self._last_m, state, covariance, stands.probability)
            self.shapes.builder.stand_on(support)


class FreeStandingOptimizer:
    """Estimates shape, pose and contacts in every frame from all frames of the trial, earlier and later ones."""

    def __init__(self, rest: RestShape, robot: FreeStandingRobot, settings: Settings) -> None:
        self._rest = rest
        self._robot = robot
        self._settings = settings

    def estimate(self, frames: Iterable[TendonLengths], progress: Progress = no_progress) -> Iterator[Shape]:
        """Yield a shape in the world for each frame, after all frames have been read.

        Args:
            frames: lengths, in order of time.
            progress: see `BatchOptimizer.estimate`.

        Raises:
            IndeterminateError: when measurements and priors leave some node undetermined.
        """
        frames = without_lag(list(frames))
        live, shapes, steps = self._live(frames)
        told_wrongly = steps[-1].imus_told_wrongly
        if told_wrongly.any():  # what they told before they were found out is wrong, too
            live, shapes, steps = self._live(without_sensors(frames, told_wrongly))
        frames = [replace(lengths, aids=shape.lengths.aids) for lengths, shape in zip(frames, shapes, strict=True)]
        contacts = self._contacts(live, frames, shapes)
        if any(
            told is not None and (told.nodes != step.standing.nodes).any()
            for told, step in zip(contacts, steps, strict=True)
        ):
            steps = self._filtered(frames, shapes, contacts)
        supports = self._supports(shapes, steps)
        shapes = [shape.without_covariance() for shape in shapes]
        del steps  # their covariances are large
        optimizer = BatchOptimizer(self._rest.structure, self._rest, self._settings)
        shapes = list(optimizer.refined(frames, live.shapes, shapes, supports, progress))
        contacts = self._contacts(live, frames, shapes)
        poses = self._poses(frames, shapes, contacts)
        assert live.kept is not None, "the live pass keeps what it learns"
        doubts_ranges = poses[-1][2].doubts_ranges  # those of before may be wrong, too
        for shape, (state, covariance, step), kept in zip(shapes, poses, live.kept, strict=True):
            if kept.standing.contradicted:
                standing = replace(step.standing, others=kept.standing.others, contradicted=True)
                step = replace(step, standing=standing)
            shape = replace(shape, contradicted_positions=kept.contradicted_positions)
            if kept.doubts_positions:
                shape = shape.in_doubt(Reason.POSITIONS)
            errors = contradiction(step, state)
            if errors is not None:
                shape = shape.in_doubt(Reason.IMU if self._robot.imus else Reason.CONTACTS)
                covariance = covariance + np.outer(errors, errors)
            contradicted_imus = step.contradicted_imus | told_wrongly
            step = replace(step, contradicted_imus=contradicted_imus, doubts_ranges=doubts_ranges)
            yield in_world(shape, self._rest, self._robot.floor, state, covariance, step, self._settings.branch)

    def _live(self, frames: Sequence[TendonLengths]) -> tuple[FreeStandingSmoother, list[Shape], list[PoseStep]]:
        """Return the live estimator after all frames, with what it has kept of them, its shapes and their poses."""
        live = FreeStandingSmoother(self._rest, self._robot, self._settings)
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
        faces = resting_faces(self._rest, self._robot, self._settings.doubt)
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

    def _supports(self, shapes: Sequence[Shape], steps: Sequence[PoseStep]) -> list[Support]:
        """Return the force of gravity and floor on each shape, from the filter's steps: slides change little of it."""
        in_the_air = nothing_stands(self._rest.structure.node_count).probability
        is_lifted = _is_lifted(steps, np.array([shape.t_s for shape in shapes]))
        return [
            support_of(
                self._rest,
                shape.node_position_m,
                state,
                covariance,
                in_the_air if lifted else step.standing.probability,
            )
            for shape, (state, covariance), lifted, step in zip(
                shapes, smoothed_poses(steps), is_lifted, steps, strict=True
            )
        ]

    def _poses(
        self, frames: Sequence[TendonLengths], shapes: Sequence[Shape], contacts: Sequence[Standing | None]
    ) -> list[tuple[PoseState, NDArray[np.float64], PoseStep]]:
        """Return the state of the pose, its covariance and the filter's step in each frame.

        Where feet slide, or the robot is lifted, which is found some time after it began, the filter runs again and
        knows it from the start.
        """
        steps = self._filtered(frames, shapes, contacts)
        t_s = np.array([lengths.t_s for lengths in frames])
        slides = slid_before(np.array([step.slides_since_s for step in steps]), t_s)
        is_lifted = _is_lifted(steps, t_s)
        if slides.any() or is_lifted.any():
            in_the_air = nothing_stands(self._rest.structure.node_count)
            contacts = [in_the_air if lifted else told for lifted, told in zip(is_lifted, contacts, strict=True)]
            steps = self._filtered(frames, shapes, contacts, slides)
        return [
            (state, covariance, step) for (state, covariance), step in zip(smoothed_poses(steps), steps, strict=True)
        ]

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


def _is_lifted(steps: Sequence[PoseStep], t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (frames,) whether the robot is in the air, as later steps of the filter may have found."""
    return slid_before(np.array([[step.lifted_since_s] for step in steps]), t_s)[:, 0]


def _stretches(looked: Sequence[int], t_s: Sequence[float]) -> list[list[int]]:
    """Return the numbers of frames in lists, each without a hole of two looks."""
    stretches: list[list[int]] = []
    for k in looked:
        if stretches and t_s[k] - t_s[stretches[-1][-1]] < 2 * FACES_EVERY_S:
            stretches[-1].append(k)
        else:
            stretches.append([k])
    return stretches
