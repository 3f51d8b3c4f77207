"""A structure that hangs from one anchor, or swings about the line of two: its shape, and how it is turned.

The shape is estimated in body coordinates, in which anchors are where they are; the pose tells the direction of the
weight, as for a structure that stands free (`estimator.free_standing`). What an anchor does to its node is no row of
the balance of forces, as in an anchored structure.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...models.balance.support import Support
from ...models.pose.large_turn import turned_covariance_m2
from ...models.pose.pose_state import PoseState
from ...models.pose.robot import HangingRobot
from ...models.settings import Settings
from ...models.structure.rest_shape import RestShape
from ...models.structure.shape import Reason, Shape
from ...models.values.readings import TendonLengths
from ...models.values.stamps import is_due
from ..batch import BatchOptimizer, without_lag
from ..free_standing.imu_trust import without_sensors
from ..free_standing.pose_smoother import PoseStep, smoothed_poses
from ..free_standing.resting_faces import balances_at
from ..free_standing.world import placed_by, support_of
from ..smoother import LiveSmoother
from ..whole_trial.trial_chain import Progress, no_progress
from .hands import Hands, HandTorque
from .hanging_filter import HangingFilter

LOOK_EVERY_S = 0.1
"""Shortest time between two looks for hands."""


class HangingSmoother:
    """Estimates shape and pose in the newest frame from this and all earlier frames."""

    def __init__(self, rest: RestShape, robot: HangingRobot, settings: Settings) -> None:
        self._rest = rest
        self.shapes = LiveSmoother(rest.structure, rest, settings)
        self._settings = settings
        self._poses = HangingFilter(rest, robot, settings)
        self._looked_s = -np.inf
        self._of_hands = Hands(rest.structure.free_nodes, settings.doubt)
        self._hands: HandTorque | None = None
        self.kept: list[tuple[HandTorque | None, Reason | None]] | None = None
        """Torque of hands and doubt in each frame, for a smoother that puts a list here; live, memory is bounded."""
        self._hang(rest.node_position_m, self._poses.state, self._poses.covariance)

    def estimate(self, frames: Iterable[TendonLengths]) -> Iterator[Shape]:
        """Yield a shape in the world for each frame, as soon as the frame arrives."""
        for lengths in frames:
            shape, step = self.update(lengths)
            shape = self.shapes.now(shape)
            yield hung_in_world(shape, self._rest, step.state, step.covariance, step, self.doubt_of(step))

    def update(self, lengths: TendonLengths) -> tuple[Shape, PoseStep]:
        """Return the shape in one more frame, in body coordinates, and its pose."""
        shape = self._poses.without_contradictions(self.shapes.update(lengths))
        if is_due(shape.t_s - self._looked_s, LOOK_EVERY_S):
            self._hands = self._look(shape, min(shape.t_s - self._looked_s, 1.0))
            self._looked_s = shape.t_s
        step = self._poses.hang(shape, self._hands, shape.lengths.aids)
        if self.kept is not None:
            self.kept.append((self._hands, self.doubt_of(step)))
        self._hang(shape.node_position_m, step.state, step.covariance)
        return shape, step

    def doubt_of(self, step: PoseStep) -> Reason | None:
        """Return what the newest step of the pose tells against the model."""
        if step.contradicted_imus.any():
            return Reason.IMU
        if step.doubts_ranges:
            return Reason.RANGES
        if self._poses.doubts_positions:
            return Reason.POSITIONS
        return Reason.HANGING if self._poses.is_contradicted else None

    def _look(self, shape: Shape, step_s: float) -> HandTorque | None:
        """Return the torque of hands by the balance of forces; None where forces or weights are unknown."""
        builder, frame, x = self.shapes.builder, self.shapes.linear, shape.node_position_m
        hanging = self._poses.hanging(x)
        if frame is None or builder.statics is None or hanging.weight_n.sum() == 0:
            return None
        balances = balances_at(x, frame, builder, self._settings.doubt.quiet_n)
        return self._of_hands.look(balances, hanging, step_s)

    def _hang(self, node_position_m: NDArray[np.float64], state: PoseState, covariance: NDArray[np.float64]) -> None:
        self.shapes.builder.stand_on(weight_of(self._rest, node_position_m, state, covariance))


class HangingOptimizer:
    """Estimates shape and pose in every frame from all frames of the trial, earlier and later ones."""

    def __init__(self, rest: RestShape, robot: HangingRobot, settings: Settings) -> None:
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
        contradicted = steps[-1].contradicted_imus
        if contradicted.any():  # what they told before they were found out is wrong, too
            live, shapes, steps = self._live(without_sensors(frames, contradicted))
        assert live.kept is not None, "the live pass keeps what it learns"
        frames = [replace(lengths, aids=shape.lengths.aids) for lengths, shape in zip(frames, shapes, strict=True)]
        left_out = [shape.contradicted_positions for shape in shapes]
        supports = [
            weight_of(self._rest, shape.node_position_m, state, covariance)
            for shape, (state, covariance) in zip(shapes, smoothed_poses(steps), strict=True)
        ]
        shapes = [shape.without_covariance() for shape in shapes]
        del steps  # their covariances are large
        optimizer = BatchOptimizer(self._rest.structure, self._rest, self._settings)
        shapes = list(optimizer.refined(frames, live.shapes, shapes, supports, progress))
        filtered = HangingFilter(self._rest, self._robot, self._settings)
        steps = [
            filtered.hang(shape, hands, lengths.aids)
            for lengths, shape, (hands, _) in zip(frames, shapes, live.kept, strict=True)
        ]
        doubts = [Reason.IMU if contradicted.any() else doubt for _, doubt in live.kept]
        if steps[-1].doubts_ranges:  # those of before may be wrong, too
            doubts = [doubt or Reason.RANGES for doubt in doubts]
        poses = smoothed_poses(steps)
        for shape, (state, covariance), step, doubt, nodes in zip(shapes, poses, steps, doubts, left_out, strict=True):
            shape = replace(shape, contradicted_positions=nodes)
            yield hung_in_world(shape, self._rest, state, covariance, step, doubt)

    def _live(self, frames: Sequence[TendonLengths]) -> tuple[HangingSmoother, list[Shape], list[PoseStep]]:
        """Return the live estimator after all frames, with what it has kept of them, its shapes and their poses."""
        live = HangingSmoother(self._rest, self._robot, self._settings)
        live.shapes.keep()
        live.kept = []
        estimates = [live.update(lengths) for lengths in frames]
        return live, [shape for shape, _ in estimates], [step for _, step in estimates]


def weight_of(
    rest: RestShape, node_position_m: NDArray[np.float64], state: PoseState, covariance: NDArray[np.float64]
) -> Support:
    """Return the force of gravity, in body axes, on a structure of this pose."""
    return support_of(rest, node_position_m, state, covariance, np.zeros(len(node_position_m)))


def hung_in_world(
    shape: Shape,
    rest: RestShape,
    state: PoseState,
    covariance: NDArray[np.float64],
    step: PoseStep,
    doubt: Reason | None,
) -> Shape:
    """Return a shape of body coordinates in the world.

    Args:
        shape: in body coordinates.
        rest: the rest shape, whose centroid is the origin of the pose.
        state: the pose.
        covariance: (size, size) of its errors.
        step: of the filter.
        doubt: what the pose tells against the model.
    """
    placed = placed_by(state, shape, rest, step)
    if doubt is not None:
        shape = shape.in_doubt(doubt)
    pivot_m = rest.structure.anchor_position_m.mean(axis=0)
    return replace(
        shape,
        node_position_m=placed.node_position_m,
        covariance_m2=turned_covariance_m2(placed, covariance, pivot_m),
        loads=shape.loads.turned(state.turn) if shape.loads else None,
        outlying_ranges=step.outlying_ranges,
    )
