"""Factors of one's own: rows worked by hand, the same evidence in graph, covariance and doubt, and contradictions."""

from dataclasses import dataclass, replace

import gtsam
import numpy as np
import pytest

from noise_settings import with_noise
from tensegraph import IndeterminateError, InputError, Settings, Status
from tensegraph.estimator.baselines.least_squares import LeastSquares
from tensegraph.estimator.doubt import log_evidence
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.estimator.linear_frame import linearised
from tensegraph.estimator.watches.factor_watch import FactorWatch
from tensegraph.factors.keys import factor_on_nodes
from tensegraph.factors.noise import weigh
from tensegraph.factors.own import own_error, own_graph_rows, own_rows, own_weight
from tensegraph.models.settings import NoiseSettings
from tensegraph.models.structure.lengths import length_jacobian, member_length_m
from tensegraph.models.structure.shape import Reason
from tensegraph.models.values.readings import FactorRows, NodeFactor


@dataclass(frozen=True)
class Heights:
    """The heights of some nodes; nan where none is read."""

    nodes: tuple[int, ...]
    height_m: tuple[float, ...]
    sigma_m: float = 0.001

    def rows(self, t_s, node_position_m) -> FactorRows:
        lead, count = node_position_m.shape[:-2], node_position_m.shape[-2]
        jacobian = np.zeros((*lead, len(self.nodes), 3 * count))
        jacobian[..., np.arange(len(self.nodes)), 3 * np.array(self.nodes) + 2] = 1.0
        residual = node_position_m[..., self.nodes, 2] - np.array(self.height_m)
        return FactorRows(residual, jacobian, np.full(residual.shape, self.sigma_m))


@dataclass(frozen=True)
class Distance:
    """The distance of two nodes, which changes with time."""

    ends: tuple[int, int] = (2, 8)
    sigma_m: float = 0.002

    def rows(self, t_s, node_position_m) -> FactorRows:
        ends = np.array([self.ends])
        residual = member_length_m(node_position_m, ends) - (0.24 + 0.01 * np.sin(t_s))[..., None]
        return FactorRows(residual, length_jacobian(node_position_m, ends), np.full(residual.shape, self.sigma_m))


def heights_of(position_m, nodes, above_m=0.0, sigma_m=0.001) -> Heights:
    return Heights(tuple(nodes), tuple(position_m[list(nodes), 2] - above_m), sigma_m)


def test_rows_and_their_weight_by_hand(rest) -> None:
    """3 mm above the reading at 1 mm: z = 3, w = 1 / (1 + 9 / 2.3849^2), rho = c^2 / 2 log(1 + z^2 / c^2)."""
    x = rest.node_position_m
    factors = [heights_of(x, [8, 5], 0.003), Heights((4,), (np.nan,))]
    z, by_position = own_rows(factors, 0.0, x)
    np.testing.assert_allclose(z, [3, 3, 0])
    assert by_position[0, 26] == by_position[1, 17] == pytest.approx(1000)
    assert np.count_nonzero(by_position) == 2
    weight = 1 / (1 + 9 / 2.3849**2)
    np.testing.assert_allclose(own_weight(z), [weight, weight, 1])
    assert own_error(factors, np.array(0.0), x) == pytest.approx(2 * 0.5 * 2.3849**2 * np.log(1 / weight))


class Untidy(Heights):
    """Writes into the positions that it is given."""

    def rows(self, t_s, node_position_m) -> FactorRows:
        told = super().rows(t_s, node_position_m)
        node_position_m[..., 2] -= 1.0
        return told


def test_a_factor_may_write_into_its_argument(rest) -> None:
    """Shapes moved with it, and the search for one did not end."""
    x = rest.node_position_m.copy()
    factors = [Untidy((8,), (0.1,)), Untidy((8,), (0.1,))]
    z, _ = own_rows(factors, 0.0, x)
    assert z[0] == z[1]
    np.testing.assert_array_equal(x, rest.node_position_m)


@pytest.mark.parametrize("sigma_m", [0.0, -1.0, 1e-320, 1e-160])
def test_a_sigma_of_nothing_counts_as_a_micrometre(rest, sigma_m: float) -> None:
    x = rest.node_position_m
    z, by_position = own_rows([heights_of(x, [8], 0.003, sigma_m)], 0.0, x)
    np.testing.assert_allclose(z, [3000])
    assert by_position[0, 26] == pytest.approx(1e6)


@pytest.mark.parametrize("factor", [Heights((8, 5), (0.2, 0.3)), Distance()])
def test_rows_are_the_derivative_in_every_frame(factor, rest, check_jacobian) -> None:
    rng = np.random.default_rng(2)
    shapes_m = rest.node_position_m + 0.01 * rng.standard_normal((3, 12, 3))
    t_s = np.array([0.0, 1.0, 2.0])
    stacked, by_position = own_rows([factor], t_s, shapes_m)
    for k, x in enumerate(shapes_m):
        alone, _ = own_rows([factor], t_s[k], x)
        np.testing.assert_allclose(alone, stacked[k])
        check_jacobian(lambda x, k=k: own_rows([factor], t_s[k], x)[0], by_position[k], x, tolerance=1e-3)


def test_gtsam_descends_on_the_kernel_s_error(rest, check_jacobian) -> None:
    """The error is that of the kernel; its gradient is that of the linearisation, far from the reading too."""
    factors = [heights_of(rest.node_position_m, [8, 5], 0.004), Distance()]
    factor = factor_on_nodes(range(12), [own_graph_rows(factors, 0.3, 3)])

    def error(x) -> np.ndarray:
        values = gtsam.Values()
        for key, point in enumerate(x):
            values.insertPoint3(key, point)
        return np.array([factor.error(values)])

    values = gtsam.Values()
    for key, point in enumerate(rest.node_position_m):
        values.insertPoint3(key, point)
    assert error(rest.node_position_m)[0] == pytest.approx(own_error(factors, np.array(0.3), rest.node_position_m))
    matrix, minus_z = factor.linearize(values).jacobian()
    check_jacobian(error, -(matrix.T @ minus_z)[None], rest.node_position_m, tolerance=0.05)


@pytest.mark.parametrize("kind", ["lengths", "forces"])
def test_the_covariance_has_its_information(kind, structure, rest, balanced, lengths_of) -> None:
    """Without loads that may hide: the inverse covariance grows by J^T J / sigma^2, as in gtsam's marginals."""
    shape_rest = rest if kind == "lengths" else balanced
    settings = with_noise(robust="none", shape_prior_m=0.0005)  # with which lengths are linear
    if kind == "forces":
        settings = replace(settings, doubt=replace(settings.doubt, loaded_share=1e-9))
    lengths = lengths_of(structure, shape_rest.node_position_m)
    factor = heights_of(shape_rest.node_position_m, [8], sigma_m=0.0005)
    free = structure.free_coordinates
    information = []
    for factors in ((), (factor,)):
        shape = FrameEstimator(structure, shape_rest, settings).update(replace(lengths, factors=factors))
        covariance = (shape.covariance_m2 - shape_rest.covariance_m2)[np.ix_(free, free)]
        information.append(np.linalg.inv(covariance))
    expected = np.zeros(36)
    expected[3 * 8 + 2] = 0.0005**-2
    added = np.diag(information[1] - information[0])
    np.testing.assert_allclose(added, expected[free], atol=2e-3 * 0.0005**-2)


def test_doubt_takes_it_as_known_beside_the_lengths(structure, balanced, lengths_of) -> None:
    """The evidence is the probability of the lengths given the factor: both together over that of the factor alone."""
    builder = GraphBuilder(structure, balanced, NoiseSettings())
    x = balanced.node_position_m
    lengths = lengths_of(structure, x, noise=0.001)
    factor = heights_of(x, [8, 5], 0.002)
    frame = linearised(builder, x, weigh(replace(lengths, factors=(factor,)), builder.noise))
    variance = np.stack([frame.force_sigma_n**2, 4 * frame.force_sigma_n**2])
    given = log_evidence(frame, 6, variance, np.ones(2))
    weighted = frame.force_jacobian[None] / variance[..., None]
    prior = np.swapaxes(weighted, 1, 2) @ frame.force_jacobian + np.eye(27) / frame.prior_m**2
    weighted_rows = (frame.own_weight[:, None] * frame.own_jacobian).T
    prior += weighted_rows @ frame.own_jacobian
    pull = (frame.force_n / variance) @ frame.force_jacobian + frame.from_prior_m / frame.prior_m**2
    pull += weighted_rows @ frame.own_error
    expected = []
    for information, gradient in zip(prior, pull, strict=True):
        mean = -np.linalg.solve(information, gradient)
        predicted = frame.length_error_m + frame.length_jacobian @ mean
        covariance = frame.length_jacobian @ np.linalg.solve(information, frame.length_jacobian.T)
        covariance += np.diag(frame.weight_per_m**-2)
        expected.append(-0.5 * (predicted @ np.linalg.solve(covariance, predicted) + np.linalg.slogdet(covariance)[1]))
    assert np.diff(given) == pytest.approx(np.diff(expected), rel=1e-4)


def test_it_may_determine_what_lengths_leave_free(structure, rest, lengths_of) -> None:
    """Without priors, and with a tendon missing, two motions are free; two heights determine them."""
    settings = with_noise(shape_prior_m=np.inf)
    lengths = lengths_of(structure, rest.node_position_m)
    lengths.length_m[[3]] = np.nan
    with pytest.raises(IndeterminateError, match="of their motions free"):
        FrameEstimator(structure, rest, settings).update(lengths)
    factors = (heights_of(rest.node_position_m, [5, 8, 11]),)
    shape = FrameEstimator(structure, rest, settings).update(replace(lengths, factors=factors))
    np.testing.assert_allclose(shape.node_position_m, rest.node_position_m, atol=2e-4)
    unread = (Heights((5, 8, 11), (np.nan,) * 3),)
    with pytest.raises(IndeterminateError, match="of their motions free"):
        FrameEstimator(structure, rest, settings).update(replace(lengths, factors=unread))


@pytest.mark.parametrize("sigma_m", [0.0002, 0.005])
def test_the_innovation_is_the_distance_from_an_estimate_without_it(sigma_m, structure, balanced, lengths_of) -> None:
    """Of a reading that counts for nearly all, and of one that counts for little."""
    lengths = lengths_of(structure, balanced.node_position_m, noise=0.0003 * np.random.default_rng(4).normal(size=24))
    estimator = FrameEstimator(structure, balanced, Settings())
    without = estimator.update(lengths)
    assert without.factor_innovation is None
    sigma = np.sqrt(sigma_m**2 + without.covariance_m2[26, 26])
    height_m = without.node_position_m[8, 2] + 0.3 * sigma  # so near that lengths and forces are linear
    factors = (Heights((8, 5), (height_m, np.nan), sigma_m),)
    shape = estimator.update(replace(lengths, factors=factors))
    np.testing.assert_allclose(shape.factor_innovation, [-0.3, np.nan], atol=0.06)


def test_a_factor_that_contradicts_is_doubt_and_one_wrong_reading_is_not(structure, rest, lengths_of) -> None:
    """A spike; later 50 sigma away for a second, and then no reading; beside it a factor that is never read."""
    innovation = np.zeros(200)
    innovation[10] = 500.0
    innovation[100:] = 50.0
    innovation[150:] = np.nan

    class Laser:
        def __init__(self, name: str) -> None:
            self._name = name

        def rows(self, t_s, node_position_m) -> FactorRows:
            return heights_of(rest.node_position_m, [8, 5]).rows(t_s, node_position_m)

        def __str__(self) -> str:
            return self._name

    lengths = replace(lengths_of(structure, rest.node_position_m), factors=(Laser("laser"), Laser("dark")))
    shape = FrameEstimator(structure, rest, Settings()).update(lengths)
    watch = FactorWatch()
    shapes = [
        watch.observe(replace(shape, t_s=k / 50, factor_innovation=np.array([0.5, u, np.nan, np.nan])))
        for k, u in enumerate(innovation)
    ]
    doubted = np.array([shape.doubt is Reason.FACTOR for shape in shapes])
    assert not doubted[:100].any()
    assert doubted[110:150].all()
    assert not doubted[190:].any()
    assert {shape.status for shape in shapes} == {Status.OK, Status.DOUBT}
    assert watch.counts() == {
        "laser: frames without a reading": 0,
        "laser: frames in which it contradicts all else": doubted.sum(),
        "dark: frames without a reading": 200,
        "dark: frames in which it contradicts all else": 0,
    }


@pytest.mark.parametrize("offset_m", [0.0, 0.05])
def test_a_wrong_reading_loses_its_weight(offset_m, structure, balanced, lengths_of) -> None:
    """50 mm beside the truth at 1 mm moves no node by half a millimetre, and does not narrow the ellipsoid."""
    lengths = lengths_of(structure, balanced.node_position_m)
    estimator = FrameEstimator(structure, balanced, Settings())
    plain = estimator.update(lengths)
    factor: NodeFactor = heights_of(balanced.node_position_m, [8], offset_m)
    shape = FactorWatch().observe(estimator.update(replace(lengths, factors=(factor,))))
    apart_m = np.abs(shape.node_position_m - plain.node_position_m).max()
    assert apart_m < 5e-4
    narrower = shape.node_sigma_m[8] / plain.node_sigma_m[8]
    assert (narrower < 0.99) == (offset_m == 0)
    assert shape.status == (Status.DOUBT if offset_m else Status.OK)


def test_what_a_factor_raises_comes_through_the_solver(structure, rest, lengths_of) -> None:
    """From inside gtsam too, where the first call, at the rest shape, still succeeds."""

    class Failing:
        def rows(self, t_s, node_position_m) -> FactorRows:
            if not np.array_equal(node_position_m, rest.node_position_m):
                raise InputError("no reading")
            return heights_of(rest.node_position_m, [8], 0.002).rows(t_s, node_position_m)

    lengths = lengths_of(structure, rest.node_position_m, noise=0.001)
    with pytest.raises(InputError, match="no reading"):
        FrameEstimator(structure, rest, Settings()).update(replace(lengths, factors=(Failing(),)))


def test_frames_with_factors_need_a_method_that_uses_them(structure, rest, lengths_of) -> None:
    lengths = lengths_of(structure, rest.node_position_m)
    frames = [replace(lengths, factors=(heights_of(rest.node_position_m, [8]),))]
    (shape,) = LeastSquares(structure, rest, Settings()).estimate(frames)
    with pytest.raises(InputError, match="the frames have factors: expected a method that uses them"):
        FactorWatch().observe(shape)
