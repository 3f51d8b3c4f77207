"""All frames at once against the graph of gtsam that they stand for, and against numbers worked by hand."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from tensegraph.estimator.doubt import Doubt
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.estimator.linear_frame import FrameData, linearised, linearised_frames
from tensegraph.estimator.uncertainty import FrameEvidence, Mixture
from tensegraph.estimator.whole_trial import trial_chain
from tensegraph.estimator.whole_trial.own_minima import own_minima
from tensegraph.estimator.whole_trial.trial_balance import TrialBalance
from tensegraph.estimator.whole_trial.trial_chain import TrialChain, minimised
from tensegraph.estimator.whole_trial.trial_factors import TrialFactors
from tensegraph.factors.motion import motion_rows
from tensegraph.factors.noise import KERNELS, robust_loss, weigh
from tensegraph.models.balance.support import Support
from tensegraph.models.estimation import DoubtSettings, NoiseSettings
from tensegraph.models.structure.lengths import length_jacobian, member_length_m
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.structure.shape import Reason
from tensegraph.models.values.readings import FactorRows, ModelError, NaturalLengths, SensorDrift

T_S = np.array([0.0, 0.02, 0.04, 0.055, 0.1, 0.12, 0.5, 0.52])
"""With a gap, and steps that are not even."""
NOISE = NoiseSettings()


class Apart:
    """A factor: how far two nodes are apart at each time, in millimetres, which is not read once."""

    def __init__(self, a: int, b: int) -> None:
        self._ends = np.array([[a, b]])

    def rows(self, t_s, node_position_m) -> FactorRows:
        residual = 1e3 * (member_length_m(node_position_m, self._ends) - (0.25 + 0.02 * t_s)[..., None])
        sigma = np.where(t_s[..., None] == 0.1, np.inf, 2.0)
        return FactorRows(residual, 1e3 * length_jacobian(node_position_m, self._ends), sigma)


FACTORS = (Apart(2, 8), Apart(0, 5))


class Trial:
    """A few frames near a rest shape, as the batch estimator and as gtsam see them."""

    def __init__(
        self, rest: RestShape, lengths_of, noise=NOISE, supports=None, wound=False, factors=(), model=None
    ) -> None:
        rng = np.random.default_rng(3)
        structure = rest.structure
        self.start_m = rest.node_position_m + 0.004 * rng.standard_normal((len(T_S), structure.node_count, 3))
        self.frames = []
        for k, t in enumerate(T_S):
            lengths = lengths_of(structure, rest.node_position_m, t, 1e-3 * rng.standard_normal(len(structure.tendons)))
            left_out = rng.random(len(structure.tendons)) < 0.1
            lengths = replace(lengths, sigma_m=np.where(left_out, np.inf, lengths.sigma_m * rng.uniform(1, 3)))
            if wound:
                natural = NaturalLengths(structure.natural_length_m - 0.002 * k, np.full(len(structure.tendons), 2e-4))
                lengths = replace(lengths, natural=natural)
            self.frames.append(replace(lengths, factors=factors, model_error=model))
        self.rest, self.noise, self.supports = rest, noise, supports
        self.measured = [weigh(lengths, noise) for lengths in self.frames]
        self.builder = GraphBuilder(structure, rest, noise)
        balance = TrialBalance.of(self.builder, self.frames, supports)
        self.balance = balance.near(self.builder, self.start_m) if balance else None
        self.factors = TrialFactors(self.builder, self.measured, self.balance)
        rows = motion_rows(T_S, noise.motion_m_per_s15, rest.largest_sigma_m if rest.at_start else None)
        self.chain = TrialChain(self.factors, rows, structure.free_coordinates, rest.node_position_m)

    def graph(self) -> gtsam.NonlinearFactorGraph:
        """The same as gtsam's factors, added frame by frame as the live estimator adds them."""
        builder = GraphBuilder(self.rest.structure, self.rest, self.noise)
        graph = gtsam.NonlinearFactorGraph()
        for k, measured in enumerate(self.measured):
            if self.supports is not None:
                builder.stand_on(self.supports[k])
            builder.approach(self.start_m[k])
            builder.add_frame(graph, k, measured)
            builder.add_motion(graph, k, T_S[max(k - 2, 0) : k + 1])
        return graph

    def values(self, position_m) -> gtsam.Values:
        values = gtsam.Values()
        for key, x in enumerate(position_m.reshape(-1, 3)):
            values.insertPoint3(key, x)
        return values


def supports_of(structure) -> list[Support]:
    rng = np.random.default_rng(4)
    count = structure.node_count
    roots = 0.05 * rng.standard_normal((len(T_S), count, 3, 3))
    return [Support(0.2 * rng.standard_normal((count, 3)), root @ np.swapaxes(root, 1, 2)) for root in roots]


KINDS = ["forces", "lengths", "huber", "cauchy", "no start", "supports", "motors", "no anchors", "factors", "model"]
MODEL_ERROR = ModelError(np.full(24, 4e-4), np.linspace(0.17, 0.19, 24), np.full(24, 0.006), np.zeros(24))


@pytest.fixture(params=KINDS)
def trial(request, balanced, lengths_of) -> Trial:
    kind = request.param
    if kind == "lengths":
        return Trial(replace(balanced, mechanics=None), lengths_of)
    if kind in ("huber", "cauchy"):
        return Trial(balanced, lengths_of, NoiseSettings(robust=kind))
    if kind == "no start":
        return Trial(replace(balanced, at_start=False), lengths_of)
    if kind == "supports":
        return Trial(balanced, lengths_of, supports=supports_of(balanced.structure))
    if kind == "motors":
        return Trial(balanced, lengths_of, wound=True)
    if kind == "no anchors":
        free = replace(balanced.structure, anchors=np.zeros(0, dtype=np.int64), anchor_position_m=np.zeros((0, 3)))
        return Trial(replace(balanced, structure=free), lengths_of, supports=supports_of(free))
    if kind == "model":
        return Trial(balanced, lengths_of, model=MODEL_ERROR)
    if kind == "factors":
        return Trial(balanced, lengths_of, factors=FACTORS)
    return Trial(balanced, lengths_of)


def test_error_and_step_are_those_of_gtsam(trial) -> None:
    """At the same shapes: the same error, and the same Gauss-Newton step, in every kind of trial."""
    graph, values = trial.graph(), trial.values(trial.start_m)
    assert trial.chain.error(trial.start_m) == pytest.approx(graph.error(values), rel=1e-9)
    stepped = values.retract(graph.linearize(values).optimize())
    position_m = gtsam.utilities.extractPoint3(stepped).reshape(trial.start_m.shape)
    np.testing.assert_allclose(trial.start_m + trial.chain.step(trial.start_m, 0.0), position_m, atol=1e-7)


def test_shapes_of_least_error_are_those_of_gtsam(balanced, lengths_of, monkeypatch) -> None:
    """To 1e-6 m, when both search until nothing changes."""
    trial = Trial(balanced, lengths_of)
    monkeypatch.setattr(trial_chain, "RELATIVE_DECREASE", 1e-13)
    position_m, _ = minimised(trial.chain, trial.start_m, steps=300)
    graph, values = trial.graph(), trial.values(trial.start_m)
    for _ in range(300):
        step = graph.linearize(values).optimize()
        values = values.retract(step)
        if step.norm() < 1e-10:
            break
    plain_m = gtsam.utilities.extractPoint3(values).reshape(position_m.shape)
    assert np.abs(plain_m - trial.start_m).max() > 0.005
    np.testing.assert_allclose(position_m, plain_m, atol=1e-6)


@pytest.mark.parametrize("factors", [(), FACTORS])
def test_assessments_of_all_frames_are_those_of_each(factors, balanced, lengths_of) -> None:
    """Shape, covariance and loads, with an error that sensors share, drift in some frames, and every kind of doubt."""
    trial = Trial(balanced, lengths_of, factors=factors, model=MODEL_ERROR)
    doubts = [Doubt(), Doubt(0.3, 1.0), Doubt(1.0, 5.0, 1.0, 0.0, Reason.MOTION), Doubt(0.9, 1.0)] * 2
    root = 3e-4 * np.random.default_rng(6).standard_normal((24, 24))
    for k in (1, 2, 5):
        drift = SensorDrift(np.zeros(24), np.zeros(24), np.zeros(24), covariance_m2=root @ root.T)
        sigma_m = np.sqrt(trial.frames[k].sigma_m ** 2 + np.diag(root @ root.T))
        trial.measured[k] = weigh(replace(trial.frames[k], sigma_m=sigma_m, drift=drift), NOISE).scaled(1.5)
    evidence = FrameEvidence(trial.builder, DoubtSettings())
    every = slice(None)
    data = FrameData.stacked(trial.measured, trial.balance.statics_of(every), trial.balance.sigma_n)
    linear = linearised_frames(trial.builder, trial.start_m, data)
    stacked = evidence.assess_frames(linear, trial.start_m, data.statics, Mixture.of(doubts))
    for k, doubt in enumerate(doubts):
        trial.builder.approach(trial.start_m[k])
        alone = linearised(trial.builder, trial.start_m[k], trial.measured[k])
        single = evidence.assess(alone, trial.start_m[k], doubt)
        np.testing.assert_allclose(stacked.node_position_m[k], single.node_position_m, atol=1e-9)
        sigma = np.sqrt(np.diagonal(single.covariance_m2))
        np.testing.assert_allclose(stacked.covariance_m2[k], single.covariance_m2, atol=1e-6 * sigma.min() ** 2)
        np.testing.assert_allclose(stacked.loads.force_n[k], single.loads.force_n, atol=1e-9)


def test_windows_do_not_show(balanced, lengths_of, monkeypatch) -> None:
    """The shapes of least error of a trial in windows of two frames that overlap by two are those of one piece."""
    trial = Trial(balanced, lengths_of)
    monkeypatch.setattr(trial_chain, "RELATIVE_DECREASE", 1e-13)
    whole_m, _ = minimised(trial.chain, trial.start_m, steps=300)
    monkeypatch.setattr(trial_chain, "WINDOW", 2)
    monkeypatch.setattr(trial_chain, "OVERLAP", 2)
    assert len(list(trial_chain._windows(len(T_S)))) == 4
    parts_m, _ = minimised(trial.chain, trial.start_m, steps=300)
    np.testing.assert_allclose(parts_m, whole_m, atol=1e-6)


@pytest.mark.parametrize("factors", [(), FACTORS])
def test_each_frame_s_minimum_is_that_of_gtsam(factors, balanced, lengths_of) -> None:
    trial = Trial(balanced, lengths_of, factors=factors)
    position_m, error = own_minima(trial.factors, trial.start_m)
    for k, measured in enumerate(trial.measured):
        trial.builder.approach(trial.start_m[k])
        minimum = trial.builder.search(measured, trial.start_m[k]).finished()
        assert error[k] == pytest.approx(minimum.error, abs=0.02)
        assert np.abs(position_m[k] - minimum.node_position_m).max() < 0.002


@pytest.mark.parametrize("wound", [False, True])
def test_explanations_of_one_frame_are_searched_as_by_gtsam(wound, balanced, lengths_of) -> None:
    """As `SensorHealth` compares them: all lengths, the same half as exact, and without one; motors wind, too."""
    trial = Trial(balanced, lengths_of, wound=wound)
    start_m, measured = trial.start_m[3], trial.measured[3]
    explanations = [measured, measured.scaled(2.0), measured.without(np.arange(24) == 14)]
    trial.builder.approach(start_m)
    expected = [trial.builder.search(one, start_m).finished().error for one in explanations]
    factors = TrialFactors(trial.builder, explanations, TrialBalance.of_newest(trial.builder, 3))
    _, error = own_minima(factors, np.tile(start_m, (3, 1, 1)))
    np.testing.assert_allclose(error, expected, atol=0.02)


@pytest.mark.parametrize("robust", ["huber", "cauchy"])
def test_losses_and_weights_are_those_of_gtsam(robust) -> None:
    z = np.array([0.0, 0.3, 1.3, 1.4, 5.0, -8.0])
    loss, weight = robust_loss(z**2, robust)
    np.testing.assert_allclose(loss, [KERNELS[robust].loss(x) for x in z])
    np.testing.assert_allclose(weight, [KERNELS[robust].weight(x) for x in z])


def test_motion_rows_by_hand() -> None:
    """Steps of 20 and 40 ms: ratio 2, sigma 0.3 sqrt(0.04) 0.03 = 1.8 mm; at rest at first, to 1 mm."""
    rows = motion_rows(np.array([0.0, 0.02, 0.06]), 0.3, 0.001)
    still = 1 / (0.3 * 0.02**1.5)
    np.testing.assert_allclose(rows, [[0, 0, 1000], [0, -still, still], [2 / 0.0018, -3 / 0.0018, 1 / 0.0018]])
    assert not motion_rows(np.array([0.0, 0.02, 0.06]), 0.3, None)[:2].any()
