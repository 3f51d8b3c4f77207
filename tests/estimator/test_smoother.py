"""The live smoother: causal, bounded, and at one with the batch graph."""

from dataclasses import replace

import numpy as np
import pytest

from balance import pressed
from noise_settings import with_noise
from tensegraph import IndeterminateError, Settings, Status, prism_tower
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.models.balance.statics import Statics
from tensegraph.models.estimation import SmootherSettings
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.stamps import SHORTEST_STEP_S


def test_a_long_lag_of_a_small_structure_is_shortened(lengths_of) -> None:
    """With more places than an update has nodes, gtsam wrote beyond its memory: the interpreter ended."""
    structure, position_m = prism_tower(1, 0.3, 0.15)
    at_rest = RestShape(structure, position_m, 1e-8 * np.eye(3 * structure.node_count), "measured")
    settings = replace(Settings(), smoother=SmootherSettings(lag=10))
    frames = [lengths_of(structure, position_m, 0.02 * k) for k in range(30)]
    shapes = list(LiveSmoother(structure, at_rest, settings).estimate(frames))
    np.testing.assert_allclose(shapes[-1].node_position_m, position_m, atol=1e-3)


def test_live_with_a_long_lag_ends_where_batch_ends(structure, rest, lengths_of) -> None:
    """The newest frame's posterior is the same whether old frames are kept, marginalised or optimised at once.

    The velocity of noise, which enters the covariance, is that of two frames in batch, and smoothed live.
    """
    rng = np.random.default_rng(3)
    frames = [
        lengths_of(structure, rest.node_position_m, 0.02 * k, noise=1e-5 * rng.standard_normal(24)) for k in range(30)
    ]
    settings = with_noise(shape_prior_m=0.003)
    batch = list(BatchOptimizer(structure, rest, settings).estimate(frames))[-1]
    for lag in (2, 5, 40):
        live = list(
            LiveSmoother(structure, rest, replace(settings, smoother=SmootherSettings(lag=lag))).estimate(frames)
        )[-1]
        np.testing.assert_allclose(live.node_position_m, batch.node_position_m, atol=5e-6)
        np.testing.assert_allclose(live.covariance_m2, batch.covariance_m2, rtol=0.02, atol=3e-9)


def test_live_uses_the_past_only(structure, rest, lengths_of) -> None:
    rng = np.random.default_rng(3)
    frames = [
        lengths_of(structure, rest.node_position_m, 0.02 * k, noise=5e-4 * rng.standard_normal(24)) for k in range(20)
    ]
    part = list(LiveSmoother(structure, rest, Settings()).estimate(frames[:10]))
    whole = list(LiveSmoother(structure, rest, Settings()).estimate(frames))
    for a, b in zip(part, whole, strict=False):
        np.testing.assert_array_equal(a.node_position_m, b.node_position_m)


def test_live_memory_is_bounded(structure, rest, lengths_of) -> None:
    smoother = LiveSmoother(structure, rest, Settings())
    sizes = []
    for k in range(200):
        smoother.update(lengths_of(structure, rest.node_position_m, 0.02 * k))
        sizes.append((smoother._isam.size(), smoother._isam.getLinearizationPoint().size()))
    assert len(set(sizes[50:])) == 1


@pytest.mark.parametrize("is_anchored", [True, False])
def test_an_update_linearises_the_newest_frame_alone(
    is_anchored: bool, structure, balanced, lengths_of, monkeypatch
) -> None:
    """Once by gtsam, and once for the covariance; frames without anchors were all linearised anew."""
    calls = []
    linearised = Statics.residual_and_jacobian
    monkeypatch.setattr(Statics, "residual_and_jacobian", lambda *args: calls.append(0) or linearised(*args))
    if not is_anchored:
        structure = replace(structure, anchors=np.zeros(0, dtype=np.int64), anchor_position_m=np.zeros((0, 3)))
    smoother = LiveSmoother(structure, replace(balanced, structure=structure), Settings())
    frames = [lengths_of(structure, balanced.node_position_m, 0.02 * k) for k in range(30)]
    for lengths in frames[:10]:
        smoother.first_shape(lengths)
    calls.clear()
    for lengths in frames[10:]:
        smoother.first_shape(lengths)
    assert len(calls) == 2 * 20


@pytest.mark.parametrize("step_s", [SHORTEST_STEP_S, 5e-4, 2e-3])
@pytest.mark.parametrize("seed", [0, 2, 3])
def test_two_frames_that_are_close_together_do_no_harm(structure, balanced, lengths_of, seed, step_s) -> None:
    """As a computer stamps rows that have waited: with a velocity of their noise, nodes were 0.9 m off from then on."""
    rng = np.random.default_rng(seed)
    noise_m = 5e-4 * rng.standard_normal((20, 24))
    t_s = 0.02 * np.arange(20)
    t_s[10] = t_s[9] + step_s
    frames = [lengths_of(structure, balanced.node_position_m, t, noise=n) for t, n in zip(t_s, noise_m, strict=True)]
    for shape in LiveSmoother(structure, balanced, Settings()).estimate(frames):
        assert shape.status == Status.OK
        assert np.abs(shape.node_position_m - balanced.node_position_m).max() < 0.005


@pytest.mark.parametrize(("step_s", "ahead_m"), [(0.02, 0.002), (0.04, 0.002), (0.05, 0.0), (0.1, 0.0)])
def test_a_slow_row_starts_at_the_last_shape(structure, rest, lengths_of, step_s: float, ahead_m: float) -> None:
    """Of a robot that moves by 2 mm from row to row."""
    smoother = LiveSmoother(structure, rest, Settings())
    for k in range(3):
        smoother.update(lengths_of(structure, rest.node_position_m, step_s * k))
    smoother._positions.extend([rest.node_position_m - 0.002, rest.node_position_m])
    np.testing.assert_allclose(smoother._predict(), rest.node_position_m + ahead_m, atol=1e-9)


@pytest.mark.parametrize("gap_s", [1.0, 3.0, 10.0])
def test_no_frames_for_a_while_and_the_shape_is_back_at_once(gap_s: float, structure, balanced, lengths_of) -> None:
    """A press at 0.1 m/s, nothing for seconds, and another shape: neither the old velocity nor a load remains."""
    load = np.zeros((12, 3))
    load[5] = [0, 0, -3.0]
    far = pressed(structure, balanced, load)
    smoother = LiveSmoother(structure, balanced, Settings())
    for k in range(25):
        position = balanced.node_position_m + k / 25 * (far - balanced.node_position_m)
        smoother.update(lengths_of(structure, position, 0.02 * k))
    for k in range(25):
        shape = smoother.update(lengths_of(structure, balanced.node_position_m, 0.5 + gap_s + 0.02 * k))
        error_m = np.linalg.norm(shape.node_position_m - balanced.node_position_m, axis=1)
        assert error_m.max() < 0.001
    assert np.nanmax(np.abs(shape.loads.force_n)) < 0.1


def test_settings_that_leave_a_node_undetermined_are_one_line(structure, rest, lengths_of) -> None:
    """Rods far more certain than the anchors that carry them."""
    smoother = LiveSmoother(structure, rest, with_noise(rod_m=1e-6, anchor_m=0.05))
    frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(20)]
    with pytest.raises(IndeterminateError, match=r"^t = 0\.\d+ s: a node is undetermined: too few lengths, or"):
        list(smoother.estimate(frames))
