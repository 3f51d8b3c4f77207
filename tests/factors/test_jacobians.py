"""The Jacobian of each factor against finite differences."""

import numpy as np
import pytest

from graph_values import KEYS, NOISE, values_of
from tensegraph.factors.anchor import anchor_factors
from tensegraph.factors.keys import factor_on_nodes
from tensegraph.factors.motion import constant_velocity_factors, still_factors
from tensegraph.factors.noise import weigh
from tensegraph.factors.rod import rod_factors
from tensegraph.factors.shape_prior import shape_prior_factors
from tensegraph.factors.tendon import correlated_tendon_rows, tendon_factors


@pytest.fixture
def positions(rest):
    rng = np.random.default_rng(5)
    return rest.node_position_m + 0.02 * rng.standard_normal((3, 12, 3))


def all_factors(structure, rest, lengths):
    free = structure.free_nodes.tolist()
    correlated = correlated_tendon_rows(structure, weigh(lengths, NOISE), np.linspace(-0.9, 0.9, 24))
    return {
        "anchor": anchor_factors(structure, KEYS[0], NOISE),
        "rod": rod_factors(structure, KEYS[0], NOISE),
        "tendon": tendon_factors(structure, KEYS[0], weigh(lengths, NOISE), NOISE.robust),
        "correlated tendons": [factor_on_nodes(KEYS[0], [correlated])],
        "shape prior": shape_prior_factors(free, KEYS[0], rest.node_position_m, NOISE.shape_prior_m),
        "still": still_factors(free, KEYS[0], KEYS[1], 0.02, NOISE.motion_m_per_s15),
        "constant velocity": constant_velocity_factors(free, KEYS, (0.02, 0.03), NOISE.motion_m_per_s15),
    }


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("anchor", 3),
        ("rod", 6),
        ("tendon", 24),
        ("correlated tendons", 1),
        ("shape prior", 9),
        ("still", 9),
        ("constant velocity", 9),
    ],
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
