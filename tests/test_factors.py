"""Each factor against its equation: the error by hand, the Jacobian against finite differences."""

import gtsam
import numpy as np
import pytest

from tensegraph import Flag, Mode, TendonLengths
from tensegraph.factors.anchor import anchor_factors
from tensegraph.factors.keys import frame_keys, key_list
from tensegraph.factors.motion import constant_velocity_factors, still_factors
from tensegraph.factors.noise import SIGMA_STEP, tendon_noises, tendon_sigma_m, weigh
from tensegraph.factors.rod import rod_factors
from tensegraph.factors.shape_prior import shape_prior_factors
from tensegraph.factors.tendon import tendon_factors
from tensegraph.models.estimation import NoiseSettings

NOISE = NoiseSettings()
KEYS = (frame_keys(0, 12), frame_keys(1, 12), frame_keys(2, 12))


def values_of(positions) -> gtsam.Values:
    """Values of (frames, 12, 3) positions."""
    values = gtsam.Values()
    for frame, position in enumerate(positions):
        for node, x in enumerate(position):
            values.insertPoint3(frame_keys(frame, 12)[node], x)
    return values


@pytest.fixture
def positions(rest):
    rng = np.random.default_rng(5)
    return rest.node_position_m + 0.02 * rng.standard_normal((3, 12, 3))


def all_factors(structure, rest, lengths):
    free = structure.free_nodes.tolist()
    return {
        "anchor": anchor_factors(structure, KEYS[0], NOISE),
        "rod": rod_factors(structure, KEYS[0], NOISE),
        "tendon": tendon_factors(structure, KEYS[0], weigh(lengths, NOISE), NOISE.robust),
        "shape prior": shape_prior_factors(free, KEYS[0], rest.node_position_m, NOISE.shape_prior_m),
        "still": still_factors(free, KEYS[0], KEYS[1], 0.02, NOISE.motion_m_per_s15),
        "constant velocity": constant_velocity_factors(free, KEYS, (0.02, 0.03), NOISE.motion_m_per_s15),
    }


@pytest.mark.parametrize(
    ("name", "count"),
    [("anchor", 3), ("rod", 6), ("tendon", 24), ("shape prior", 9), ("still", 9), ("constant velocity", 9)],
)
def test_jacobians(name, count, structure, rest, lengths_of, positions, check_jacobian) -> None:
    """The whitened Jacobian that gtsam linearises with is the derivative of the whitened error."""
    factors = all_factors(structure, rest, lengths_of(structure, rest.node_position_m))[name]
    assert len(factors) == count
    for factor in factors:
        keys = sorted(factor.keys())
        index = [divmod(key, 12) for key in keys]

        def whitened(x, factor=factor, index=index):
            moved = positions.copy()
            for (frame, node), point in zip(index, x, strict=True):
                moved[frame, node] = point
            return -factor.linearize(values_of(moved)).jacobian()[1]

        matrix, _ = factor.linearize(values_of(positions)).jacobian()
        order = np.argsort(np.argsort(list(factor.keys())))
        blocks = matrix.reshape(len(matrix), -1, 3)[:, order]
        x = np.array([positions[frame, node] for frame, node in index])
        check_jacobian(whitened, blocks.reshape(len(matrix), -1), x, tolerance=1e-3 * np.abs(matrix).max())


def test_rod_and_tendon_errors_by_hand(structure, rest, lengths_of) -> None:
    """A rod 1 mm too long at sigma 0.2 mm costs (1 / 0.2)^2 / 2; a tendon 2 mm off at 0.5 mm with 0.2 mm of its own."""
    lengths = lengths_of(structure, rest.node_position_m)
    values = values_of([rest.node_position_m])
    short = NoiseSettings()
    rod = gtsam.RangeFactor3(0, 3, 0.299, rod_factors(structure, KEYS[0], short)[0].noiseModel())
    assert rod.error(values) == pytest.approx(0.5 * 5**2, rel=1e-2)
    lengths.length_m[3] += 0.002
    tendon = tendon_factors(structure, KEYS[0], weigh(lengths, NOISE), NOISE.robust)[3]
    assert tendon.error(values) == pytest.approx(0.5 * 0.002**2 / (0.0005**2 + 0.0002**2), rel=2 * SIGMA_STEP)


def test_constant_velocity_by_hand() -> None:
    """x = 0, 1, 3 mm at 0, 20, 40 ms: second difference 1 mm, sigma q dt^1.5."""
    positions = np.zeros((3, 12, 3))
    positions[1, 3, 0], positions[2, 3, 0] = 0.001, 0.003
    (factor,) = constant_velocity_factors([3], KEYS, (0.02, 0.02), 0.3)
    assert factor.error(values_of(positions)) == pytest.approx(0.5 * (0.001 / (0.3 * 0.02**1.5)) ** 2)


@pytest.mark.parametrize("steps", [(0.02, 0.02), (0.01, 0.05), (0.1, 0.02)])
def test_constant_velocity_costs_nothing_at_any_steps(steps) -> None:
    t = np.array([0.0, steps[0], sum(steps)])
    positions = t[:, None, None] * np.random.default_rng(0).standard_normal((12, 3))
    for factor in constant_velocity_factors(range(12), KEYS, steps, 0.3):
        assert factor.error(values_of(positions)) == pytest.approx(0, abs=1e-12)


def test_motion_factors_of_several_nodes_do_not_share_keys() -> None:
    factors = constant_velocity_factors(range(3, 12), KEYS, (0.02, 0.02), 0.3)
    assert [list(f.keys()) for f in factors] == [[n, 12 + n, 24 + n] for n in range(3, 12)]


def test_sigma_of_a_tendon_in_one_place() -> None:
    lengths = TendonLengths(
        0.0,
        np.array([0.1, 0.1, 0.1, np.nan, 0.1]),
        np.array([0.0003, 0.0003, 0.0003, np.inf, np.inf]),
        np.array([Mode.STRETCHING, Mode.BENDING, Mode.BENDING, Mode.STRETCHING, Mode.STRETCHING]),
        np.array([0, 0, Flag.AMBIGUOUS, Flag.MISSING, 0]),
    )
    own = np.array([NOISE.stretching_m, NOISE.bending_m, NOISE.ambiguous_m])
    expected = [*np.hypot(own, 0.0003), np.inf, np.inf]
    np.testing.assert_allclose(tendon_sigma_m(lengths, NOISE), expected)


def test_missing_tendons_have_no_factor(structure, rest, lengths_of) -> None:
    lengths = lengths_of(structure, rest.node_position_m)
    lengths.length_m[[4, 7]] = np.nan
    assert len(tendon_factors(structure, KEYS[0], weigh(lengths, NOISE), NOISE.robust)) == 22


def test_noise_models_are_kept() -> None:
    first, second = tendon_noises(np.array([0.0005, 0.000501]), "none")
    assert first is second
    assert tendon_noises(np.array([0.0005]), "huber")[0] is not first


@pytest.mark.parametrize("robust", ["huber", "cauchy"])
def test_robust_kernels_cap_an_outlier(structure, rest, lengths_of, robust) -> None:
    lengths = lengths_of(structure, rest.node_position_m)
    lengths.length_m[3] += 0.05
    values = values_of([rest.node_position_m])
    plain, capped = (
        tendon_factors(structure, KEYS[0], weigh(lengths, NOISE), kernel)[3].error(values)
        for kernel in ("none", robust)
    )
    assert capped < 0.1 * plain


def test_no_shape_prior_when_it_is_infinite(rest) -> None:
    assert shape_prior_factors(range(3, 12), KEYS[0], rest.node_position_m, np.inf) == []


def test_keys_are_frame_major() -> None:
    assert list(frame_keys(1, 6)) == [6, 7, 8, 9, 10, 11]
    assert key_list([1, 2]).size() == 2
