"""The doubt about the model: evidence, and what a smoother does with them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from balance import pressed
from linear_frames import linear_frame
from noise_settings import with_noise
from tensegraph import Flag, Settings
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.doubt import LEAST_WEIGHED, ModelDoubt, evidence_share, log_evidence
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.estimator.linear_frame import linearised
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.factors.noise import weigh
from tensegraph.models.structure.shape import Reason, Status


def test_evidence_is_the_probability_of_the_lengths() -> None:
    """A linear problem of two coordinates: the evidence is the density of the lengths, its prior being that of x."""
    rng = np.random.default_rng(1)
    jacobian, forces = rng.normal(size=(3, 2)), rng.normal(size=(4, 2))
    frame = linear_frame(
        length_error_m=np.array([0.3, -0.2, 0.5]),
        length_jacobian=jacobian,
        weight_per_m=np.array([2.0, 1.5, 3.0]),
        force_n=np.array([0.2, 0.1, -0.4, 0.3]),
        force_jacobian=forces,
        force_weight_per_n=np.ones(4),
        force_sigma_n=np.ones(4),
        from_prior_m=np.array([0.1, -0.3]),
        prior_m=0.8,
    )
    variance = np.array([[1.0, 1.0, 1.0, 1.0], [4.0, 4.0, 0.25, 0.25], [1.0, 1.0, 1.0, 1.0]])
    scale = np.array([1.0, 1.0, 3.0])
    expected = []
    for v, k in zip(variance, scale, strict=True):
        information = forces.T @ (forces / v[:, None]) + np.eye(2) / 0.64
        mean = -np.linalg.solve(information, forces.T @ (frame.force_n / v) + frame.from_prior_m / 0.64)
        sigma = np.array([0.5, 1 / 1.5 * k, 1 / 3 * k])  # the first member is a rod
        spread = jacobian @ np.linalg.inv(information) @ jacobian.T + np.diag(sigma**2)
        expected.append(multivariate_normal.logpdf(-frame.length_error_m, jacobian @ mean, spread))
    found = log_evidence(frame, 1, variance, scale)
    np.testing.assert_allclose(found - found[0], np.array(expected) - expected[0])


def at_shape(structure, balanced, lengths_of, load_n, seconds, seed=3):
    """Frames at 10 Hz of the shape under loads, with errors that last as long as the settings say."""
    position = pressed(structure, balanced, load_n) if np.any(load_n) else balanced.node_position_m
    rng = np.random.default_rng(seed)
    t_s = np.arange(0, seconds, 0.1)
    lasting_m = np.repeat(rng.normal(0, 3e-4, (len(t_s) // 26 + 1, len(structure.tendons))), 26, axis=0)
    return [lengths_of(structure, position, t, 4e-4, noise) for t, noise in zip(t_s, lasting_m, strict=False)]


def inward(structure, balanced, force_n):
    """Forces on every free node towards the middle of the structure."""
    middle = balanced.node_position_m.mean(axis=0) - balanced.node_position_m
    load = force_n * middle / np.linalg.norm(middle, axis=1, keepdims=True)
    load[structure.anchors] = 0
    return load


def test_a_few_loads_raise_no_doubt_and_many_do(structure, balanced, lengths_of) -> None:
    """One node pressed with 2 N fits the model; 0.8 N sideways at every node does not."""
    one = np.zeros((12, 3))
    one[5] = [0, 0, -2.0]
    many = np.zeros((12, 3))
    many[structure.free_nodes, 0] = 0.8
    found = {}
    for name, load in (("none", 0 * one), ("one", one), ("many", many)):
        frames = at_shape(structure, balanced, lengths_of, load, 7.0)
        found[name] = list(LiveSmoother(structure, balanced, Settings()).estimate(frames))[-1]
    assert found["none"].doubt is None
    assert found["one"].doubt is None
    assert found["many"].doubt is Reason.LOADS
    assert found["many"].node_sigma_m.mean() > 1.5 * found["one"].node_sigma_m.mean()


@pytest.mark.parametrize("are_told", [True, False])
def test_hands_that_take_a_robot_leave_no_doubt_before(structure, balanced, lengths_of, are_told) -> None:
    """Many nodes are loaded from 3 s on: a smoother that is not told of hands doubts the second before as well."""
    many = np.zeros((12, 3))
    many[structure.free_nodes, 0] = 0.8
    frames = at_shape(structure, balanced, lengths_of, 0.0, 3.0)
    frames += [replace(one, t_s=3.0 + one.t_s) for one in at_shape(structure, balanced, lengths_of, many, 6.0)]
    smoother = LiveSmoother(structure, balanced, Settings())
    smoother.keep()
    for k, frame in enumerate(frames):
        if are_told and k == 30:
            smoother.doubt.forget_loads()
        smoother.update(frame)
    assert smoother.doubt.present.reason is Reason.LOADS
    smoothed = [doubt.reason for doubt in smoother.doubt.smoothed(frames)]
    assert smoothed[31] is Reason.LOADS
    assert (Reason.LOADS in smoothed[20:30]) != are_told


@pytest.mark.parametrize("estimator", [LiveSmoother, BatchOptimizer])
def test_contradicting_lengths_widen_the_ellipsoids_and_say_so(estimator, structure, balanced, lengths_of) -> None:
    """Errors of 4 mm under sigmas of 0.4 mm: the truth stays inside, and no single sensor is blamed for all."""
    rng = np.random.default_rng(4)
    error_m = rng.normal(0, 0.004, len(structure.tendons))
    frames = [lengths_of(structure, balanced.node_position_m, t, 4e-4, error_m) for t in np.arange(0, 8, 0.1)]
    last = list(estimator(structure, balanced, Settings()).estimate(frames))[-1]
    assert last.doubt is Reason.SENSORS
    error = (last.node_position_m - balanced.node_position_m)[structure.free_nodes]
    covariance = last.node_covariance_m2[structure.free_nodes]
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    assert nees.mean() / 3 < 1.5
    assert (last.lengths.usable).sum() >= 16


@pytest.mark.parametrize(("times_sigma", "least", "most"), [(0.4, 0.4, 0.6), (1.0, 0.92, 1.0)])
def test_residuals_tell_how_exact_lengths_are(structure, balanced, lengths_of, times_sigma, least, most) -> None:
    """Errors of 0.3 mm are 0.4 times their sigma, or as large: more than without evidence, 0.9."""
    smoother = LiveSmoother(structure, balanced, with_noise(stretching_m=1e-6))
    sigma_m = np.full(len(structure.tendons), 3e-4 / times_sigma)
    for frame in at_shape(structure, balanced, lengths_of, 0.0, 12.0):
        smoother.update(replace(frame, sigma_m=sigma_m))
    found = smoother.doubt.present
    assert least < found.length_scale * found.error_scale < most


def test_lengths_that_may_be_less_exact_are_not_taken_for_more_exact(structure, balanced) -> None:
    """They are four times less exact with a probability of 0.4: weights say so, and the covariance keeps it."""
    doubt = ModelDoubt(GraphBuilder(structure, balanced, Settings().noise), Settings().doubt)
    doubt._scale.probability = np.array([0, 0, 0, 0.6, 0, 0.4, 0, 0])
    assert doubt.present.length_scale == pytest.approx(1 / np.sqrt(0.6 + 0.4 / 16))
    assert doubt.present.error_scale == 1
    doubt._scale.probability = np.array([0, 0, 0, 0, 0, 0, 1.0, 0])
    assert doubt.present.error_scale == 1


def test_shaking_is_seen_in_both_directions_of_time(structure, balanced, lengths_of) -> None:
    """Half of the tendons swing at 1 to 2 s, a fifth for 0.5 s before and after; it began 0.8 s before it was seen."""
    lengths = lengths_of(structure, balanced.node_position_m)
    frames = []
    for t in np.arange(0, 4, 0.1):
        share = 0.5 if 1 <= t < 2 else 0.2 if 0.5 <= t < 2.5 else 0.0
        swings = np.arange(len(structure.tendons)) % 10 < 10 * share
        frames.append(replace(lengths, t_s=t, flags=np.where(swings, int(Flag.SHAKEN), 0)))
    builder = GraphBuilder(structure, balanced, Settings().noise)
    doubt = ModelDoubt(builder, Settings().doubt)
    doubt.kept = []
    live = []
    for frame in frames:
        linear = linearised(builder, balanced.node_position_m, weigh(frame, builder.noise))
        doubt.observe(frame.t_s, linear, 1.0)
        doubt.see(frame)
        live.append(doubt.present.reason is Reason.MOTION)
    both = [found.reason is Reason.MOTION for found in doubt.smoothed(frames)]
    assert [frames[k].t_s for k in np.flatnonzero(live)][:: len(frames)] == pytest.approx([1.0])
    assert frames[np.flatnonzero(both)[0]].t_s == pytest.approx(0.2)
    assert frames[np.flatnonzero(both)[-1]].t_s == pytest.approx(2.4)


def test_lengths_that_tell_nothing_of_loads_are_no_evidence_for_many(structure, balanced, lengths_of) -> None:
    """For a minute lengths are known to 1 m: whether few nodes are loaded or many is as it was before."""
    lengths = lengths_of(structure, balanced.node_position_m, sigma_m=1.0)
    builder = GraphBuilder(structure, balanced, Settings().noise)
    doubt = ModelDoubt(builder, Settings().doubt)
    linear = linearised(builder, balanced.node_position_m, weigh(lengths, builder.noise))
    for t in np.arange(0, 60, 0.1):
        doubt.observe(t, linear, 1.0)
    assert doubt.present.many_loads == pytest.approx(Settings().doubt.many_share, rel=0.05)


def test_no_lengths_are_no_evidence(structure, balanced, lengths_of) -> None:
    """Without readings the doubt goes back to what it is before any."""
    missing = lengths_of(structure, balanced.node_position_m, noise=np.nan)
    builder = GraphBuilder(structure, balanced, Settings().noise)
    doubt = ModelDoubt(builder, Settings().doubt)
    for t in np.arange(0, 60, 0.1):
        frame = replace(missing, t_s=t)
        doubt.observe(t, linearised(builder, balanced.node_position_m, weigh(frame, builder.noise)), 1.0)
    found = doubt.present
    assert found.many_loads == pytest.approx(Settings().doubt.many_share)
    assert LEAST_WEIGHED < found.length_scale < 1
    assert found.error_scale == pytest.approx(0.97, abs=0.01)


@pytest.mark.parametrize("estimator", [LiveSmoother, BatchOptimizer])
def test_without_a_shape_prior_forces_and_lengths_are_enough(estimator, structure, balanced, lengths_of) -> None:
    frames = [lengths_of(structure, balanced.node_position_m, t) for t in np.arange(0, 1, 0.1)]
    last = list(estimator(structure, balanced, with_noise(shape_prior_m=np.inf)).estimate(frames))[-1]
    assert last.status is Status.OK
    assert np.linalg.norm(last.node_position_m - balanced.node_position_m) < 1e-4


def test_shaking_widens_without_forces_as_well(structure, rest, lengths_of) -> None:
    """No stiffness is known: the ellipsoids of a shaken frame are wider, in batch from the first such frame on."""
    frames = [lengths_of(structure, rest.node_position_m, t) for t in np.arange(0, 1, 0.1)]
    shaken = [replace(frame, flags=np.full(24, int(Flag.SHAKEN))) for frame in frames]
    for estimator in (LiveSmoother, BatchOptimizer):
        calm, swinging = (
            next(iter(estimator(structure, rest, Settings()).estimate(each))).node_sigma_m[structure.free_nodes]
            for each in (frames, shaken)
        )
        assert (swinging > 1.2 * calm).all()


def test_lengths_of_no_free_tendon_are_no_evidence(structure, balanced, lengths_of) -> None:
    """Of 24 tendons, 21 move with free nodes; with half of the time between frames that counts, half counts."""
    builder = GraphBuilder(structure, balanced, Settings().noise)
    lengths = lengths_of(structure, balanced.node_position_m, 0.0)
    linear = linearised(builder, balanced.node_position_m, weigh(lengths, builder.noise))
    step_s = 0.5 * builder.noise.correlation_s
    assert evidence_share(builder, linear, step_s) == pytest.approx(0.5)
    rods = replace(linear, weight_per_m=linear.weight_per_m[: len(structure.rods)])
    assert evidence_share(builder, rods, step_s) == 0
