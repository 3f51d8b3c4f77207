"""Natural lengths that motors change: string and strip by hand, and rows that are late, absurd or missing."""

from dataclasses import replace

import numpy as np
import pytest

from four_nodes import four_nodes
from tensegraph import Flag, InputError
from tensegraph.models.structure.natural_lengths import MAX_SILENCE_S, UNKNOWN_SHARE, Motors, Winding, strip_length_m
from tensegraph.models.values.readings import (
    Mode,
    ModelError,
    ModeReadings,
    NaturalLengthReading,
    RestLengths,
    TendonLengths,
)

LAG_S = 0.04
WOUND = 2
"""The tendon with a motor; its natural length is 0.1 m, of which 0.06 m are strip."""
MOTORS = (Motors((WOUND,), 0.06),)


def winding(rest_seconds: float = 0.0, *, reads_strips: bool = True) -> Winding:
    return Winding(four_nodes(), MOTORS, rest_seconds, reads_strips=reads_strips)


def row(t_s: float, natural_length_m: float, sigma_m: float = 0.0003) -> NaturalLengthReading:
    return NaturalLengthReading(t_s, WOUND, natural_length_m, sigma_m)


def strips(t_s: float, sigma_m: float = 0.0004) -> TendonLengths:
    """Every strip is 0.066 m long: a strain of 10 % in the wound tendon."""
    length_m = np.full(4, 0.066)
    nothing = np.zeros(4, dtype=np.int64)
    modes = ModeReadings(np.stack([length_m, length_m]), np.full((2, 4), sigma_m), np.zeros(4))
    return TendonLengths(t_s, length_m, np.full(4, sigma_m), nothing, nothing, lag_s=LAG_S, modes=modes)


class TestLengths:
    def test_string_and_strip_by_hand(self) -> None:
        """L0 = 0.09 m: 0.03 m of string, and 0.066 m of strip; 0.3 and 0.4 mm make 0.5 mm."""
        motor = winding()
        motor.add(row(1.0, 0.09))
        motor.add(row(1.1, 0.09))
        lengths = motor.applied(strips(1.05 + LAG_S))
        assert lengths.length_m == pytest.approx([0.066, 0.066, 0.096, 0.066])
        assert lengths.sigma_m == pytest.approx([0.0004, 0.0004, 0.0005, 0.0004])
        assert lengths.modes.length_m[:, WOUND] == pytest.approx(0.096)
        assert lengths.modes.sigma_m[:, WOUND] == pytest.approx(0.0005)
        assert lengths.natural.length_m == pytest.approx([0.1, 0.1, 0.09, 0.1])
        assert lengths.natural.sigma_m == pytest.approx([0, 0, 0.0003, 0])

    def test_what_sensors_share_is_that_of_the_strips(self) -> None:
        """A motor that winds moves the tared length along: the strip is as long as it was."""
        error = ModelError(np.full(4, 0.0003), np.full(4, 0.063), np.full(4, 0.006), np.zeros(4))
        lengths = replace(strips(0.0), model_error=error)
        expected = error.shared_m(lengths.length_m)
        motor = winding()
        motor.add(row(0.0, 0.09))
        wound = motor.applied(lengths)
        assert wound.length_m[WOUND] != lengths.length_m[WOUND]
        assert wound.model_error.shared_m(wound.length_m) == pytest.approx(expected)

    def test_between_two_rows_it_is_on_the_line_at_the_time_that_the_sensors_show(self) -> None:
        motor = winding()
        motor.add(row(1.0, 0.1))
        motor.add(row(1.2, 0.08))
        assert motor.applied(strips(1.15 + LAG_S)).natural.length_m[WOUND] == pytest.approx(0.085)

    def test_measured_distances_stay_and_their_mode_is_that_of_the_present_natural_length(self) -> None:
        motor = winding(reads_strips=False)
        motor.add(row(0.0, 0.12))
        whole = replace(strips(0.0), length_m=np.full(4, 0.11), lag_s=0.0, modes=None)
        lengths = motor.applied(whole)
        np.testing.assert_array_equal(lengths.length_m, whole.length_m)
        np.testing.assert_array_equal(lengths.sigma_m, whole.sigma_m)
        assert lengths.mode.tolist() == [Mode.STRETCHING, Mode.STRETCHING, Mode.BENDING, Mode.STRETCHING]

    def test_without_motors_lengths_are_the_same_object(self) -> None:
        lengths = strips(0.0)
        assert Winding(four_nodes(), (), 2.0, reads_strips=True).applied(lengths) is lengths

    def test_at_rest_strips_are_tendons_without_their_strings(self) -> None:
        rest = winding().strips(RestLengths(2.0, np.full(4, 0.11), np.full(4, 0.001)))
        assert rest.length_m == pytest.approx([0.11, 0.11, 0.07, 0.11])
        assert strip_length_m(four_nodes(), MOTORS) == pytest.approx([0.1, 0.1, 0.06, 0.1])


class TestRows:
    def test_only_the_change_since_the_rest_counts_and_another_zero_is_said(self) -> None:
        """The encoder reads 0.3 m where trial.toml says 0.1 m, then 0.01 m less."""
        motor = winding(rest_seconds=1.0)
        for k in range(5):
            motor.add(row(0.1 * k, 0.3))
            motor.applied(strips(0.1 * k))
        for k in range(16):
            motor.add(row(0.5 + 0.1 * k, 0.3 if k < 8 else 0.29))
        lengths = motor.applied(strips(1.95))
        assert lengths.natural.length_m[WOUND] == pytest.approx(0.09)
        assert motor.counts()["motor of tendon 2: rows at rest unlike natural_length_m"] == 10

    def test_at_rest_nothing_need_be_told(self) -> None:
        motor = winding(rest_seconds=1.0)
        lengths = motor.applied(strips(0.5))
        assert lengths.length_m[WOUND] == pytest.approx(0.106)
        assert lengths.natural.sigma_m[WOUND] == 0

    def test_after_the_last_row_sigma_grows_as_the_motor_may_go_on(self) -> None:
        """0.1 m/s for 0.2 s are 20 mm more, beside 0.3 mm."""
        motor = winding()
        motor.add(row(0.9, 0.1))
        motor.add(row(1.0, 0.09))
        natural = motor.applied(strips(1.2 + LAG_S)).natural
        assert natural.length_m[WOUND] == pytest.approx(0.09)
        assert natural.sigma_m[WOUND] == pytest.approx(np.hypot(0.0003, 0.02))

    def test_a_motor_that_is_silent_leaves_its_tendon_out_and_is_said(self) -> None:
        motor = winding()
        motor.add(row(1.0, 0.09))
        lengths = motor.applied(strips(1.01 + MAX_SILENCE_S + LAG_S))
        assert np.isnan(lengths.length_m[WOUND])
        assert np.isinf(lengths.sigma_m[WOUND])
        assert lengths.flags.tolist() == [0, 0, Flag.MISSING, 0]
        assert lengths.natural.sigma_m[WOUND] == pytest.approx(UNKNOWN_SHARE * 0.1)
        assert motor.counts()["motor of tendon 2: frames without its rows"] == 1
        motor.add(row(2.0, 0.09))
        motor.add(row(2.1, 0.09))
        assert motor.applied(strips(2.05 + LAG_S)).length_m[WOUND] == pytest.approx(0.096)

    @pytest.mark.parametrize("absurd_m", [0.5, 0.05])
    def test_rows_that_no_motor_makes_are_left_out_and_counted(self, absurd_m) -> None:
        """0.4 m in 20 ms; or shorter than the strip alone."""
        motor = winding()
        for k in range(10):
            motor.add(row(1.0 + 0.02 * k, absurd_m if k == 5 else 0.09))
            assert motor.applied(strips(1.0 + 0.02 * k + LAG_S)).natural.length_m[WOUND] == pytest.approx(0.09)
        assert motor.counts()["motor of tendon 2: absurd rows"] == 1


@pytest.mark.parametrize(
    ("motors", "message"),
    [
        (Motors((), 0.06), r"tendons: expected different tendons, at least one, got \[\]"),
        (Motors((1, 1), 0.06), r"tendons: expected different tendons, at least one, got \[1, 1\]"),
        (Motors((4,), 0.06), r"tendons: expected tendons from 0 to 3, got 4"),
        (Motors((1,), 0.2), r"strip_length_m: expected at most the natural length of tendon 1, 0.1 m, got 0.2"),
    ],
)
def test_motors_that_cannot_be_are_refused(motors, message) -> None:
    with pytest.raises(InputError, match=message):
        motors.check(four_nodes())
