"""The balance of forces as a factor."""

import gtsam
import numpy as np
import pytest

from balance import nominal, pressed
from tensegraph.factors.equilibrium import equilibrium_rows
from tensegraph.factors.keys import factor_on_nodes
from tensegraph.models.balance.statics import Statics
from tensegraph.models.structure.form_finding import find_rest_shape


class TestFactor:
    def test_error_and_gradient_are_those_of_the_kernel(self, structure, check_jacobian) -> None:
        """1/2 sum log(1 + q); the linear factor's gradient is its derivative, weights 1 / (1 + q) and all."""
        statics, sigma_n = Statics(structure, nominal(structure)), 0.1
        position = find_rest_shape(structure) + 0.002 * np.random.default_rng(3).standard_normal((12, 3))
        graph = gtsam.NonlinearFactorGraph()
        graph.add(factor_on_nodes(range(12), [equilibrium_rows(statics, np.full(len(statics.group), sigma_n))]))

        def values_at(x):
            values = gtsam.Values()
            for node, point in enumerate(x):
                values.insertPoint3(node, point)
            return values

        def kernel(x):
            r = statics.residual_n(x) / sigma_n
            q = np.bincount(statics.group, r * r)
            return 0.5 * np.log1p(q).sum()

        assert graph.error(values_at(position)) == pytest.approx(kernel(position))
        jacobian, b = graph.linearize(values_at(position)).jacobian()
        check_jacobian(lambda x: np.array([kernel(x)]), -(b @ jacobian), position, step=1e-7, tolerance=1e-2)

    def test_one_pressed_node_is_excused_alone(self, structure, balanced) -> None:
        """A load of 3 N at one node costs log(1 + 900) / 2 and the weight of that node's rows, not of the others'."""
        statics = Statics(structure, balanced.mechanics)
        load = np.zeros((12, 3))
        load[5] = [0, 0, -3.0]
        position = pressed(structure, balanced, load)
        r = statics.residual_n(position)
        by_node = np.linalg.norm(r[:27].reshape(9, 3), axis=1)
        node = structure.free_nodes.tolist().index(5)
        assert by_node[node] > 1
        assert np.delete(by_node, node).max() < 1e-5
