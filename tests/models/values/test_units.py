"""The range of each quantity, told by the unit in its name."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegraph import InputError, six_strut
from tensegraph.models.values.units import LARGEST_NUMBER, check_ranges, largest


@pytest.mark.parametrize(
    ("name", "limit"),
    [("rod_length_m", 1e4), ("tendon_stiffness_n_per_m", 1e9), ("t_s", 1e11), ("n3_x_m", 1e4), ("bits", 1e15)],
)
def test_the_unit_is_the_longest_that_ends_the_name(name: str, limit: float) -> None:
    assert largest(name) == limit


@given(st.floats(-LARGEST_NUMBER, LARGEST_NUMBER, allow_nan=False))
def test_numbers_within_the_range_pass(value: float) -> None:
    check_ranges({"pairs": [[value, 0.5 * value]]})


@pytest.mark.parametrize("value", [1e20, -4e305, 10**4000])
def test_a_number_beyond_is_named_with_its_key(value: float) -> None:
    with pytest.raises(InputError, match=r"load\[1\]\.height_m: expected a magnitude of at most 10000, got .*unit"):
        check_ranges({"load": [{"height_m": 1.0}, {"height_m": value}]})


def test_infinite_is_left_to_the_field() -> None:
    check_ranges({"shape_prior_m": float("inf")})


@pytest.mark.parametrize("factor", [1000.0, 0.001])
def test_positions_in_another_unit_are_refused(factor: float) -> None:
    structure = six_strut(0.3)
    position_m = np.random.default_rng(0).normal(size=(4, structure.node_count, 3)) * 0.1
    position_m[:, 3] = np.nan
    structure.check_unit("truth", position_m)
    with pytest.raises(InputError, match=r"truth: .* unit"):
        structure.check_unit("truth", factor * position_m)


def test_one_node_has_no_size() -> None:
    structure = six_strut(0.3)
    position_m = np.full((2, structure.node_count, 3), np.nan)
    position_m[:, 4] = 1000.0
    structure.check_unit("truth", position_m)
