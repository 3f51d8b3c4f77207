"""From codes to resistances, eq. (1), and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegraph import InputError
from tensegraph.models.sensor.divider import Divider

KNOWN_OHM = 5.8e6


class TestDivider:
    def test_by_hand(self) -> None:
        """Code 511 of 1024: 511.5 / 512.5 to ground, its inverse to the supply; sigma (R + Rk)^2 / (Rk N sqrt 12)."""
        ground, supply = Divider(10, KNOWN_OHM, "ground"), Divider(10, KNOWN_OHM, "supply")
        codes = np.array([511])
        assert ground.resistance_ohm(codes)[0] == pytest.approx(KNOWN_OHM * 511.5 / 512.5)
        assert supply.resistance_ohm(codes)[0] == pytest.approx(KNOWN_OHM * 512.5 / 511.5)
        assert ground.sigma_ohm(np.array([KNOWN_OHM]))[0] == pytest.approx(4 * KNOWN_OHM / (1024 * np.sqrt(12)))

    @given(st.integers(1, 1022), st.sampled_from(["ground", "supply"]))
    def test_a_resistance_is_read_as_its_code(self, code: int, side) -> None:
        divider = Divider(10, KNOWN_OHM, side)
        assert divider.counts(divider.resistance_ohm(np.array([code])))[0] == code

    @given(st.floats(0.01, 100))
    def test_code_of_a_resistance_gives_it_back(self, ratio: float) -> None:
        divider = Divider(16, KNOWN_OHM, "ground")
        code = np.array([int(ratio / (1 + ratio) * divider.codes)])
        error = divider.resistance_ohm(code)[0] - ratio * KNOWN_OHM
        assert abs(error) <= np.sqrt(12) * divider.sigma_ohm(np.array([ratio * KNOWN_OHM]))[0]

    def test_end_codes_are_saturated(self) -> None:
        divider = Divider(10, KNOWN_OHM, "ground")
        assert divider.saturated(np.array([0, 1, 1022, 1023])).tolist() == [True, False, False, True]
        assert divider.counts(np.array([0.0, np.inf])).tolist() == [0, 1023]

    @pytest.mark.parametrize("arguments", [(0, 1.0, "ground"), (10, 0.0, "ground"), (10, np.nan, "supply")])
    def test_impossible_ones_are_refused(self, arguments) -> None:
        with pytest.raises(InputError, match="expected"):
            Divider(*arguments)
