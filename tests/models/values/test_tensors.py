"""Tensors from files: shapes by the names of their axes, and numbers that can be used."""

import numpy as np
import pytest

from tensegraph import InputError
from tensegraph.models.values.tensors import check_covariance, check_rising, checked_tensors

AXES = {"a": "3 rows, rows", "b": "rows, columns"}


def test_the_first_axis_that_bears_a_name_tells_its_size() -> None:
    checked = checked_tensors({"a": np.ones((6, 2), np.float32), "b": np.zeros((2, 5)), "c": np.ones(1)}, AXES, {})
    assert set(checked) == {"a", "b"}
    assert checked["a"].dtype == np.float64


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        ((7, 2), (2, 5), r"'a': expected the shape \(3 rows, rows\) = \(6, 2\), got \(7, 2\)"),
        ((6, 2), (3, 5), r"'b': expected the shape \(rows, columns\) = \(2, 5\), got \(3, 5\)"),
        ((6, 2), (2,), r"'b': .*got \(2,\)"),
        ((0, 0), (0, 5), r"'a': .*got \(0, 0\)"),
    ],
)
def test_other_shapes_are_refused(a, b, message) -> None:
    with pytest.raises(InputError, match=message):
        checked_tensors({"a": np.zeros(a), "b": np.zeros(b)}, AXES, {})


def test_a_size_that_is_told_counts() -> None:
    with pytest.raises(InputError, match=r"\(rows, columns\) = \(2, 4\), got \(2, 5\)"):
        checked_tensors({"a": np.zeros((6, 2)), "b": np.zeros((2, 5))}, AXES, {"columns": 4})


@pytest.mark.parametrize("values", [[0.0], [0.0, 0.0], [1.0, 0.0]])
def test_knots_must_rise(values) -> None:
    with pytest.raises(InputError, match="'k': expected at least two numbers"):
        check_rising("k", np.array(values))


@pytest.mark.parametrize("matrix", [[[1.0, 2.0], [2.0, 1.0]], [[1.0, 0.1], [0.2, 1.0]]])
def test_a_covariance_is_symmetric_and_positive(matrix) -> None:
    with pytest.raises(InputError, match="expected a covariance"):
        check_covariance("c", np.array(matrix))
    check_covariance("c", np.array([[1.0, 0.5], [0.5, 1.0]]))
