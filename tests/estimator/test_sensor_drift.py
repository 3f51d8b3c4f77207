"""The drift of each sensor by itself, from rods and the balance of forces."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from blank_figures import blank_figures
from tensegraph import Settings, reconstruct, save
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.graph import FrameSearch, GraphBuilder
from tensegraph.estimator.linear_frame import linearised
from tensegraph.estimator.rest.rest_step import rest_step
from tensegraph.estimator.sensor_drift import DriftState, DriftUpdate, is_of_a_board, length_evidence, smoothed_drift
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.estimator.uncertainty import FrameEvidence
from tensegraph.factors.noise import weigh
from tensegraph.models.sensor.reference_drift import drift_transition
from tensegraph.models.structure.external_loads import ExternalLoads
from tensegraph.models.structure.mechanics import Mechanics
from tensegraph.models.structure.rest_shape import GeometrySigma, RestShape
from tensegraph.models.structure.shape import Reason
from tensegraph.models.values.readings import ModelError, SensorDrift, TendonLengths

PER_CHANGE_M = 0.14


def test_smoother_agrees_with_least_squares_of_all_times() -> None:
    """One sensor's level and rate, measured at five times: the smoother's means solve the joint problem."""
    transition = drift_transition(1, 1.0, 30.0)
    start, noise, readings = (
        np.diag([1e-12, 1.0]),
        np.diag([0.05, 1 - transition[1, 1] ** 2]),
        [0.3, 1.1, 1.4, 2.9, 3.1],
    )
    mean, covariance, updates = np.zeros(2), start, []
    for k, reading in enumerate(readings):
        mean, covariance = transition @ mean, transition @ covariance @ transition.T + noise
        predicted = DriftState(float(k), mean, covariance)
        gain = covariance[:, :1] / (covariance[0, 0] + 0.1)
        mean, covariance = mean + gain[:, 0] * (reading - mean[0]), covariance - gain @ covariance[:1]
        updates.append(DriftUpdate(predicted, transition, DriftState(float(k), mean, covariance)))
    prior = np.zeros((10, 10))
    spread = start
    for k in range(5):
        spread = transition @ spread @ transition.T + noise
        for j in range(k, 5):
            block = np.linalg.matrix_power(transition, j - k) @ spread
            prior[2 * j : 2 * j + 2, 2 * k : 2 * k + 2] = block
            prior[2 * k : 2 * k + 2, 2 * j : 2 * j + 2] = block.T
    reads = np.eye(10)[::2]
    gain = prior @ reads.T @ np.linalg.inv(reads @ prior @ reads.T + 0.1 * np.eye(5))
    states = smoothed_drift(updates)
    np.testing.assert_allclose(np.concatenate([s.mean for s in states]), gain @ readings, atol=1e-6)
    left = prior - gain @ reads @ prior
    np.testing.assert_allclose([s.covariance[0, 0] for s in states], np.diag(left)[::2], atol=1e-6)


@pytest.fixture(scope="module")
def still(example_structure, true_positions) -> RestShape:
    """The example structure where it rests, with stiffness that balances there."""
    _, positions = true_positions
    count = len(example_structure.tendons)
    mechanics = Mechanics(np.full(count, 400.0), example_structure.natural_length_m, 0.03, 0.02)
    return replace(
        rest_step(example_structure, mechanics, positions[0], GeometrySigma(), Settings().rest), at_start=True
    )


def with_drift(lengths: TendonLengths, own_rate_per_s: float) -> TendonLengths:
    zero = np.zeros(len(lengths.length_m))
    return replace(lengths, drift=SensorDrift(zero, zero, zero + PER_CHANGE_M, 1.0, own_rate_per_s, 3))


@pytest.mark.parametrize("model_sigma_m", [0.0, 4e-4])
def test_evidence_is_the_slope_of_the_best_error(model_sigma_m, example_structure, still, lengths_of) -> None:
    """By the envelope theorem, -u = d/db min_x error(x; lengths - b): the frame's own optimiser says the same."""
    builder = GraphBuilder(example_structure, still, Settings().noise)
    rng = np.random.default_rng(1)
    lengths = lengths_of(example_structure, still.node_position_m, noise=rng.normal(0, 5e-4, 24))
    untared = ModelError(np.full(24, model_sigma_m), np.full(24, np.nan), np.ones(24), np.zeros(24))
    lengths = replace(lengths, model_error=untared)

    def least(length_m: NDArray[np.float64]) -> FrameSearch:
        search = builder.search(weigh(replace(lengths, length_m=length_m), builder.noise), still.node_position_m)
        for _ in range(30):
            search.finished()
            search = builder.search(weigh(replace(lengths, length_m=length_m), builder.noise), search.node_position_m)
        return search

    position = least(lengths.length_m).node_position_m
    _, gradient = length_evidence(builder, position, lengths)

    def error(length_m: NDArray[np.float64]) -> float:
        return least(length_m).error

    for e in (3, 8, 20):
        step_m = 5e-5 * np.eye(24)[e]
        ahead = error(lengths.length_m - step_m)
        behind = error(lengths.length_m + step_m)
        assert -(ahead - behind) / 1e-4 == pytest.approx(gradient[e], rel=0.02, abs=20)


def test_a_drift_that_all_share_makes_a_larger_ellipsoid_than_independent_ones(
    example_structure, still, lengths_of
) -> None:
    """The same variance of each length, once as one unknown of all, once as one of each."""
    builder = GraphBuilder(example_structure, still, Settings().noise)
    evidence = FrameEvidence(builder, Settings().doubt)

    def trace_of(measured: TendonLengths) -> float:
        frame = linearised(builder, still.node_position_m, weigh(measured, builder.noise))
        return float(np.trace(evidence.assess(frame, still.node_position_m).covariance_m2))

    lengths = with_drift(lengths_of(example_structure, still.node_position_m, sigma_m=1e-3), 0.0)
    trace = []
    for covariance in (np.full((24, 24), 0.9e-6), 0.9e-6 * np.eye(24)):
        drifting = replace(lengths, drift=replace(lengths.drift, covariance_m2=covariance))
        trace.append(trace_of(drifting))
    plain = trace_of(lengths)
    assert trace[1] == pytest.approx(plain)
    assert trace[0] != pytest.approx(plain, rel=0.05)


def drifting_frames(
    structure, still: RestShape, lengths_of, rate: float
) -> tuple[list[TendonLengths], NDArray[np.float64]]:
    """Return frames of a structure at rest for 20 s whose sensors drift each at a rate of its own, and that drift."""
    rng = np.random.default_rng(2)
    t_s = np.arange(0, 20, 0.1)
    own = rate * rng.standard_normal(24)
    change = np.outer(t_s, own - own[:3].mean())
    lasting_m = np.repeat(rng.normal(0, 5e-4, (8, 24)), 26, axis=0)[: len(t_s)]  # for the 2.6 s of the settings
    error_m = PER_CHANGE_M * change + lasting_m
    frames = [
        with_drift(lengths_of(structure, still.node_position_m, t, noise=error), rate if t > 3 else 0.0)
        for t, error in zip(t_s, error_m, strict=True)
    ]
    return frames, change


@pytest.mark.parametrize("estimator", [LiveSmoother, BatchOptimizer])
def test_own_drift_is_found_and_its_sigma_is_true(estimator, example_structure, still, lengths_of) -> None:
    frames, change = drifting_frames(example_structure, still, lengths_of, 6e-4)
    shapes = list(estimator(example_structure, still, Settings()).estimate(frames))
    last = shapes[-1].lengths.drift
    free = example_structure.free_tendons
    error = (last.change - change[-1])[free]
    assert np.sqrt(np.mean(error**2)) < 0.4 * np.sqrt(np.mean(change[-1, free] ** 2))
    assert 0.3 < np.mean((error / last.sigma[free]) ** 2) < 2.0
    plain = list(estimator(example_structure, still, Settings()).estimate([replace(f, drift=None) for f in frames]))
    moved_m = [[shape.node_position_m - still.node_position_m for shape in s[100:]] for s in (shapes, plain)]
    with_drift, without = (np.sqrt(np.mean(np.square(m))) for m in moved_m)
    assert with_drift < 0.6 * without


def test_frames_before_a_drift_tell_that_there_was_none(example_structure, still, lengths_of) -> None:
    """Sensors drift apart from 12 s on: in batch, the frames until then are not corrected by a drift from the start."""
    frames, change = drifting_frames(example_structure, still, lengths_of, 6e-4)
    late = np.searchsorted([frame.t_s for frame in frames], 12.0)
    change = np.maximum(np.arange(len(frames)) - late, 0)[:, None] * (change[-1] / (len(frames) - 1 - late))
    frames = [
        with_drift(lengths_of(example_structure, still.node_position_m, frame.t_s, noise=PER_CHANGE_M * of_frame), rate)
        for frame, of_frame, rate in zip(frames, change, np.where(np.arange(len(frames)) > late, 6e-4, 0), strict=True)
    ]
    shapes = list(BatchOptimizer(example_structure, still, Settings()).estimate(frames))
    free = example_structure.free_tendons
    grown = np.abs(change[-1, free]).mean()
    for shape in shapes[40:100:20]:  # carried back evenly from where it is found, it is 0.10 to 0.21 of that
        assert np.abs(shape.lengths.drift.change[free]).mean() < 0.09 * grown
    assert np.abs((shapes[-1].lengths.drift.change - change[-1])[free]).mean() < 0.7 * grown


@pytest.mark.parametrize(("load_n", "learns"), [(0.0, True), (1.0, False)])
def test_a_loaded_frame_says_nothing_of_drift(load_n, learns, example_structure, still, lengths_of) -> None:
    frames, _ = drifting_frames(example_structure, still, lengths_of, 6e-4)
    smoother = LiveSmoother(example_structure, still, Settings())
    *_, last = (smoother.update(frame) for frame in frames[:60])
    drift = smoother.drift
    assert last.loads is not None
    force_n = np.zeros((12, 3))
    force_n[5, 2] = load_n
    drift.kept = []
    drift.admit(frames[60])
    drift.observe(replace(last, loads=ExternalLoads(force_n, np.full(12, 0.05)), t_s=frames[60].t_s))
    (update,) = drift.kept
    assert learns == bool((np.diag(update.state.covariance) < np.diag(update.predicted.covariance)).any())


def test_nothing_changes_while_sensors_do_not_differ(example_structure, still, lengths_of) -> None:
    lengths = with_drift(lengths_of(example_structure, still.node_position_m), 0.0)
    smoother = LiveSmoother(example_structure, still, Settings())
    assert smoother.drift.admit(lengths) is lengths


def test_the_drift_is_written_and_drawn(trial_copy, tmp_path) -> None:
    reconstruction = reconstruct(trial_copy(rows=160), "live")
    with blank_figures():
        save(reconstruction, tmp_path / "result")
    rows = (tmp_path / "result" / "sensor_drift.csv").read_text().splitlines()
    assert rows[0] == "t_s,tendon,drift,sigma"
    assert len(rows) == 1 + 24 * len(reconstruction)
    values = np.array([row.split(",") for row in rows[1:]], dtype=float)
    assert np.abs(values[:, 2]).max() < 1e-3
    assert (tmp_path / "result" / "sensor_drift.png").is_file()


def test_before_it_began_the_drift_grew_from_zero(example_structure) -> None:
    """Half the time from the start: half the drift, a quarter of its variance, and the same rate."""
    state = DriftState(8.0, np.array([0.02, 0.001]), np.array([[4e-4, 1e-5], [1e-5, 1e-6]]))
    half = state.earlier(5.0, first_s=2.0)
    assert half.t_s == 5.0
    np.testing.assert_allclose(half.mean, [0.01, 0.001])
    np.testing.assert_allclose(half.covariance, [[1e-4, 5e-6], [5e-6, 1e-6]])


def test_lengths_that_contradict_each_other_begin_it(example_structure, still, lengths_of) -> None:
    lengths = with_drift(lengths_of(example_structure, still.node_position_m), 0.0)
    smoother = LiveSmoother(example_structure, still, Settings())
    smoother.drift.admit(lengths)
    assert smoother.drift.admit(replace(lengths, t_s=5.0), inexact=0.3).drift.covariance_m2 is not None
    assert smoother.drift.begins


@pytest.mark.parametrize("estimator", [LiveSmoother, BatchOptimizer])
def test_lengths_that_no_drift_explains_stay_in_doubt(estimator, example_structure, still, lengths_of) -> None:
    """From 4 s on, lengths contradict each other by 9 mm, as where a tendon has snapped; no drift is that fast."""
    apart_m = 0.009 * np.sign(np.random.default_rng(4).standard_normal(24))
    apart_m[~example_structure.is_free_tendon] = 0.0
    frames = [
        with_drift(lengths_of(example_structure, still.node_position_m, t, noise=apart_m * (t > 4)), 0.0)
        for t in np.arange(0, 20, 0.1)
    ]
    shapes = list(estimator(example_structure, still, Settings()).estimate(frames))
    assert {shape.doubt for shape in shapes[60:]} == {Reason.SENSORS}
    assert shapes[-1].lengths.drift.covariance_m2 is None


@pytest.mark.parametrize(("of_second_board", "expected"), [(0.0, False), (0.005, False), (0.03, True)])
def test_a_drift_that_goes_with_the_board_is_of_the_board(of_second_board: float, expected: bool) -> None:
    """Each sensor has drifted by its own 1 %: boards differ by 0.4 %, more or less. One board has lost more."""
    own = 0.01 * np.random.default_rng(3).standard_normal(24)
    board = np.repeat([0, 1], 12)
    drift = SensorDrift(own + of_second_board * board, np.full(24, 0.004), np.ones(24), board=board)
    assert not is_of_a_board(drift), "each sensor's own is not estimated"
    assert is_of_a_board(replace(drift, covariance_m2=np.eye(24))) == expected
    assert not is_of_a_board(replace(drift, covariance_m2=np.eye(24), board=np.zeros(24, dtype=np.int64)))
    later = np.where(board > 0, 2, 1)  # no tendon is on board 0
    assert is_of_a_board(replace(drift, covariance_m2=np.eye(24), board=later)) == expected
