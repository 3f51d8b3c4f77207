"""Lengths that are told: sensors that are stuck, and noise that is larger than its sigma."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegraph import Flag, InputError, Structure, six_strut
from tensegraph.models.sensor.gate import GateSettings
from tensegraph.models.told_lengths import LASTING_M, ToldLengths, WaysAround, lengths_at_rest
from tensegraph.models.values.readings import TendonLengths
from told_rows import rows_of

FULL_M = np.full(4, 0.2)
REST_S = 2.0
STRUCTURE = Structure(
    rods=[(0, 1)],
    tendons=[(0, 2), (2, 1), (1, 3), (3, 0)],
    rod_length_m=0.3,
    natural_length_m=0.2,
    anchors=[0, 1, 2],
    anchor_position_m=[(0, 0, 0), (0.3, 0, 0), (0.15, 0.13, 0)],
)
SIX_STRUT = six_strut(0.3)
WAYS = WaysAround(SIX_STRUT, SIX_STRUT.natural_length_m)


def checked(length_m: np.ndarray, sigma_m: float = np.nan) -> tuple[list[TendonLengths], ToldLengths]:
    """Return (rows, 4) lengths at 50 Hz after the check, and the check; no row is late."""
    told = ToldLengths(GateSettings(), STRUCTURE, FULL_M, REST_S, unstated_m=0.001)
    return [told.checked(row) for row in rows_of(length_m, sigma_m)], told


def noise(rows: int, sigma_m: float = 0.001) -> np.ndarray:
    return FULL_M + sigma_m * np.random.default_rng(3).standard_normal((rows, 4))


def flagged(rows: list[TendonLengths], flag: Flag) -> np.ndarray:
    return np.array([(row.flags & flag) != 0 for row in rows])


def pressed(rows: int, sigma_m: float = 0.001, begin: int = 100) -> np.ndarray:
    """Noise about lengths that swing by 20 mm from some row on, each in another phase."""
    phase = 0.05 * np.maximum(np.arange(rows) - begin, 0)[:, None] + np.zeros(4)
    return noise(rows, sigma_m) + 0.02 * np.sin(phase * [1.0, 1.1, 1.2, 1.3])


def test_rows_that_repeat_a_stamp_are_left_out() -> None:
    told = ToldLengths(GateSettings(), STRUCTURE, FULL_M, REST_S, unstated_m=0.001)
    first, late, next_one = rows_of([FULL_M] * 3, 0.001, [0.02, 0.02005, 0.04])
    assert [told.checked(row) is None for row in (first, late, next_one)] == [False, True, False]
    assert told.warnings() == {"lengths": "1 rows left out, which are not 0.0001 s later than the one before"}


@pytest.mark.parametrize(
    ("length_m", "sigma_m", "message"),
    [(FULL_M[:3], 0.001, "expected 4 lengths and sigmas"), (FULL_M, 0.0, "expected sigmas above 0, got 0")],
)
def test_rows_that_are_none_are_refused(length_m, sigma_m, message) -> None:
    with pytest.raises(InputError, match=f"lengths at 0 s: {message}"):
        checked(length_m[None], sigma_m)


class TestWaysAround:
    """Of a rod of 0.3 m with a triangle of two tendons of 0.2 m to both sides."""

    @pytest.mark.parametrize(("length_m", "is_too_long"), [(0.2, False), (0.54, False), (0.56, True), (2.0, True)])
    def test_no_tendon_is_longer_than_a_rod_and_another_tendon(self, length_m, is_too_long) -> None:
        """0.3 m + 0.2 m, and a tenth."""
        rows, _ = checked(np.array([[0.2, 0.2, 0.2, length_m]]))
        assert (np.isnan(rows[0].length_m) == [False, False, False, is_too_long]).all()
        assert (flagged(rows, Flag.OUT_OF_RANGE)[0] == [False, False, False, is_too_long]).all()

    def test_others_count_as_they_are_read_and_not_where_nothing_is_read(self) -> None:
        ways = WaysAround(STRUCTURE, FULL_M)
        assert not ways.too_long(np.array([0.2, 0.2, 0.3, 0.6])).any()
        assert not ways.too_long(np.array([0.2, 0.2, np.nan, 2.0])).any()
        assert ways.too_long(np.array([np.nan, 0.2, 0.2, 0.6])).tolist() == [False, False, False, True]

    def test_a_length_that_is_too_short_accuses_no_other(self) -> None:
        assert not WaysAround(STRUCTURE, FULL_M).too_long(np.array([0.2, 0.2, 0.02, 0.45])).any()

    @given(st.integers(0, 10_000))
    def test_no_shape_has_such_lengths(self, seed) -> None:
        """Wherever the nodes are, whose rods have their lengths."""
        rng = np.random.default_rng(seed)
        position_m = 0.2 * rng.standard_normal((12, 3))
        for a, b in SIX_STRUT.rods:
            way_m = position_m[b] - position_m[a]
            position_m[b] = position_m[a] + 0.3 * way_m / np.linalg.norm(way_m)
        assert not WAYS.too_long(SIX_STRUT.tendon_length_m(position_m)).any()


class TestLoneJumps:
    def outliers(self, others_m: float, known: int = 4) -> np.ndarray:
        """Return (200, 4) what is left out where a length jumps by 0.1 m from row 100 to 149, and others by less."""
        length_m = noise(200)
        length_m[100:150] += np.array([others_m, 0.1, 0.0, 0.0])
        length_m[:, known:] = np.nan
        return flagged(checked(length_m)[0], Flag.OUTLIER)

    def test_one_that_no_other_joins_is_left_out_until_it_is_back(self) -> None:
        left_out = self.outliers(0.0)
        assert left_out[100:150, 1].all()
        assert not left_out[:, [0, 2, 3]].any()
        assert not left_out[:100, 1].any()
        assert not left_out[153:, 1].any()

    @pytest.mark.parametrize("others_m", [0.04, 0.018])
    def test_one_that_another_joins_is_motion(self, others_m) -> None:
        """As little as another length changed where a slack structure of the twin collapsed: by 0.18 of its way."""
        assert not self.outliers(others_m)[103:150, 1].any()

    def test_where_one_other_is_read_nobody_can_tell(self) -> None:
        assert not self.outliers(0.0, known=2)[103:150, 1].any()


class TestStuck:
    def test_a_sensor_that_repeats_itself_while_others_change_is_left_out_after_a_second(self) -> None:
        length_m = pressed(300)
        length_m[150:, 2] = length_m[150, 2]
        rows, _ = checked(length_m)
        stuck = flagged(rows, Flag.STUCK)
        assert not stuck[:200].any()
        assert not stuck[:, [0, 1, 3]].any()
        assert stuck[200:, 2].mean() > 0.8
        assert np.isnan(rows[-1].length_m[2])
        assert rows[-1].sigma_m[2] == np.inf

    def test_it_is_used_again(self) -> None:
        length_m = pressed(400)
        length_m[150:250, 2] = length_m[150, 2]
        stuck = flagged(checked(length_m)[0], Flag.STUCK)
        assert stuck[200:250, 2].any()
        assert not stuck[250:].any()

    @pytest.mark.parametrize("sigma_m", [0.0001, 0.0003, 0.001])
    def test_coarse_steps_are_read_again_and_again_in_another_pose(self, sigma_m) -> None:
        """Steps of 1 mm: at rest between two of them, and held in the middle of one later."""
        length_m = noise(800, sigma_m) + 0.0005
        length_m[200:] += 0.0305
        steps_m = np.round(length_m / 0.001) * 0.001
        assert not flagged(checked(steps_m)[0], Flag.STUCK).any()

    def test_sensors_that_are_slower_than_the_file(self) -> None:
        """Each row twice: the rows that repeat are none, and a sensor that is stuck stays so in them."""
        length_m = pressed(300)
        length_m[150:, 2] = length_m[150, 2]
        stuck = flagged(checked(np.repeat(length_m, 2, axis=0))[0], Flag.STUCK)
        assert not stuck[:, [0, 1, 3]].any()
        np.testing.assert_array_equal(stuck[1::2], stuck[::2])
        assert stuck[400:, 2].mean() > 0.8

    def test_lengths_without_noise_and_whole_rows_say_nothing(self) -> None:
        without_noise = np.repeat(FULL_M[None], 400, axis=0)
        without_noise[100:, 0] += 1e-4 * np.arange(300)  # at rest before, and then one tendon moves
        assert not flagged(checked(without_noise)[0], Flag.STUCK).any()
        repeated = noise(300)
        repeated[150:] = repeated[150]
        assert not flagged(checked(repeated)[0], Flag.STUCK).any()


class TestScatter:
    def test_a_sigma_that_is_too_small_is_widened(self) -> None:
        """Noise of 5 mm, told as 1 mm: by the variance of 100 values, to within a tenth or so."""
        rows, told = checked(noise(150, 0.005))
        np.testing.assert_allclose(rows[-1].sigma_m, 0.005, rtol=0.25)
        assert list(told.warnings()) == [f"tendon {e}" for e in range(4)]
        assert "scatters by" in told.warnings()["tendon 0"]

    @pytest.mark.parametrize("sigma_m", [0.001, 0.002])
    def test_one_that_is_right_or_too_large_is_as_told(self, sigma_m) -> None:
        rows, told = checked(noise(150), sigma_m)
        assert all((row.sigma_m == sigma_m).all() for row in rows)
        assert not told.warnings()

    @pytest.mark.parametrize("begin", [100, 30])
    def test_what_moves_does_not_scatter(self, begin) -> None:
        """After the rest, and in it: that a structure moves at rest is for `RestWatch` to tell."""
        assert not checked(pressed(300, begin=begin))[1].warnings()

    def test_a_length_that_no_tendon_has_is_left_out(self) -> None:
        length_m = noise(10)
        length_m[4, 1], length_m[6, 2] = -0.2, 5.0
        rows, _ = checked(length_m)
        assert np.argwhere(flagged(rows, Flag.OUT_OF_RANGE)).tolist() == [[4, 1], [6, 2]]
        assert np.isnan([rows[4].length_m[1], rows[6].length_m[2]]).all()

    def test_a_value_that_jumps_at_rest_is_left_out_and_does_not_count(self) -> None:
        length_m = noise(150)
        length_m[60, 1] = 0.4
        rows, told = checked(length_m)
        assert np.argwhere(flagged(rows, Flag.OUTLIER)).tolist() == [[60, 1]]
        assert not told.warnings()


@pytest.mark.parametrize(
    ("shorter", "sigma_m", "is_named"), [(1.0, np.nan, False), (0.1, np.nan, True), (0.1, 0.001, False)]
)
def test_a_sigma_that_nobody_has_told_is_named_where_it_is_large(shorter, sigma_m, is_named) -> None:
    """1 mm of tendons of 200 or 20 mm."""
    structure = replace(
        STRUCTURE,
        rod_length_m=shorter * STRUCTURE.rod_length_m,
        natural_length_m=shorter * STRUCTURE.natural_length_m,
        anchor_position_m=shorter * STRUCTURE.anchor_position_m,
    )
    told = ToldLengths(GateSettings(), structure, shorter * FULL_M, REST_S, unstated_m=0.001)
    for row in rows_of([shorter * FULL_M] * 3, sigma_m):
        told.checked(row)
    text = "none is given: noise.unstated_m, 1 mm, counts, 5.0% of a tendon: what moves lengths by less may be missed"
    assert told.warnings() == ({"sigma of lengths": text} if is_named else {})


class TestLengthsAtRest:
    def rows(self, length_m: np.ndarray) -> list[TendonLengths]:
        return rows_of(length_m, np.where(np.isnan(length_m), np.inf, 0.001))

    def test_by_hand(self) -> None:
        """Four readings of 0.200 and 0.202 m: mean 0.201, sigma of 1 mm / 2 and what they share."""
        length_m = np.tile([[0.2], [0.202]], (2, 4))
        length_m[:, 3] = np.nan
        length_m[0, 2] = np.nan
        at_rest, moved = lengths_at_rest(self.rows(length_m), 0.08)
        assert at_rest.length_m[:3] == pytest.approx([0.201, 0.201, (0.202 + 0.2 + 0.202) / 3])
        assert at_rest.sigma_m[:3] == pytest.approx(np.hypot(0.001 / np.sqrt([4, 4, 3]), LASTING_M))
        assert at_rest.is_read.tolist() == [True, True, True, False]
        assert not moved

    def test_many_readings_are_not_independent(self) -> None:
        at_rest, moved = lengths_at_rest(self.rows(noise(400)), 8.0)
        assert at_rest.sigma_m == pytest.approx(np.hypot(0.001 / 5, LASTING_M))
        assert not moved

    def test_of_a_structure_that_moves_sigma_is_half_of_the_motion(self) -> None:
        """5 mm at two tendons alone are their sensors', at three the structure's."""
        for tendons in (2, 3):
            length_m = noise(200, 1e-6)
            length_m[100:, :tendons] += 0.005
            at_rest, moved = lengths_at_rest(self.rows(length_m), 4.0)
            assert moved == (tendons == 3)
            expected_m = np.sqrt(0.0002**2 + LASTING_M**2 + (0.0025 if moved else 0.0) ** 2)
            assert at_rest.sigma_m[0] == pytest.approx(expected_m, rel=0.01)
