"""The front end as a whole: from frames of resistance to lengths with sigma, mode and flags."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegraph import Flag, Mode
from tensegraph.io.model_file import read_sensor_model
from tensegraph.models.sensor.bending import BendingCurve
from tensegraph.models.sensor.front_end import FrontEnd, FrontEndSettings
from tensegraph.models.sensor.reference_drift import DriftSettings, ReferenceTendons
from tensegraph.models.sensor.sensor_model import SensorModel
from tensegraph.models.sensor.stretching import StrainSpread
from tensegraph.models.values.readings import (
    ResistanceFrame,
    RestLengths,
    TendonLengths,
    is_impossible_length,
    is_mode_uncertain,
)


def front_end(
    model: SensorModel, count: int = 4, rest_strain: float | None = 0.08, rest_s: float = 1.0, **kwargs
) -> FrontEnd:
    rest = (
        None
        if rest_strain is None
        else RestLengths(rest_s, np.full(count, 0.17 * (1 + rest_strain)), np.full(count, 3e-4))
    )
    return FrontEnd(
        model=model,
        natural_resistance_ohm=np.full(count, 6e6),
        natural_length_m=np.full(count, 0.17),
        rest=rest,
        settings=FrontEndSettings(**kwargs),
        frame_step_s=0.02,
        references=ReferenceTendons(np.empty(0, dtype=np.int64), DriftSettings()),
        is_held=True,
    )


def step(end: FrontEnd, frame: ResistanceFrame) -> TendonLengths:
    """The lengths in one more frame."""
    return end.lengths([frame])[0]


def frame(k: int, change, flags=0) -> ResistanceFrame:
    change = np.broadcast_to(np.asarray(change, dtype=float), (4,))
    flags = np.where(np.isnan(change), int(Flag.MISSING), 0) | flags
    return ResistanceFrame(0.02 * k, 6e6 * (1 + change), np.full(4, 6e3), flags)


class TestFrontEnd:
    def test_rest_is_where_it_is_said_to_be(self, model: SensorModel) -> None:
        end = front_end(model)
        for k in range(200):
            lengths = step(end, frame(k, [0.07, 0.08, 0.085, 0.1]))
        np.testing.assert_allclose(lengths.length_m, 0.17 * 1.08, atol=2e-4)
        assert (lengths.mode == Mode.STRETCHING).all()
        assert (lengths.flags == 0).all()

    @pytest.mark.parametrize(("rest_strain", "reach"), [(0.08, 0.11), (0.01, 0.04), (-0.02, 0.03), (None, 0.03)])
    def test_the_model_s_error_is_told(self, model: SensorModel, rest_strain: float | None, reach: float) -> None:
        """Its part of sigma, the tared length, and a reach of 3 % and the rest strain."""
        end = front_end(model, rest_strain=rest_strain)
        for k in range(120):
            lengths = step(end, frame(k, 0.07 if k < 60 else 0.1))
        error = lengths.model_error
        assert error is not None
        assert (error.sigma_m > 0).all()
        assert (error.sigma_m < lengths.sigma_m).all()
        tared_m = np.nan if rest_strain is None else 0.17 * (1 + rest_strain)
        np.testing.assert_allclose(error.tared_length_m, tared_m)
        np.testing.assert_allclose(error.reach_m, 0.17 * reach)

    def test_motion_leaves_an_error_at_the_tared_length(self, model: SensorModel) -> None:
        """Of strips that were moved, and only of those; 0.06 of the spread of their strain in the last half minute."""
        end = front_end(model)
        swing = 0.05 * np.sin(2 * np.pi * np.arange(250) / 250)
        path = np.concatenate([np.zeros(100), swing, np.zeros(50)])
        moved = np.array([1.0, 1.0, 0.0, 0.0])
        lengths = [step(end, frame(k, 0.07 + y * moved)) for k, y in enumerate(path)]
        strain = np.array([one.length_m for one in lengths]) / 0.17 - 1
        expected_m = 0.06 * 0.17 * StrainSpread(4).run(strain, np.full((len(strain), 1), 0.02))[-1]
        error = lengths[-1].model_error
        assert error is not None
        shared_m = error.shared_m(error.tared_length_m)
        np.testing.assert_allclose(shared_m, expected_m, rtol=0.02)
        assert (shared_m[:2] > 1e-4).all()
        assert (shared_m[2:] < 1e-5).all()

    def test_a_bent_tendon_has_no_error_of_the_stretching_model(self, model: SensorModel) -> None:
        end = front_end(model)
        path = np.concatenate([np.full(100, 0.08), np.linspace(0.08, -0.3, 100), np.full(150, -0.3)])
        lengths = [step(end, frame(k, y)) for k, y in enumerate(path)][-1]
        assert lengths.model_error is not None
        assert (lengths.model_error.sigma_m < 0.1 * lengths.sigma_m).all()

    def test_bending_is_found_and_left_again(self, model: SensorModel) -> None:
        end = front_end(model)
        path = np.concatenate([np.full(100, 0.08), np.linspace(0.08, -0.3, 100), np.full(150, -0.3)])
        path = np.concatenate([path, np.linspace(-0.3, 0.08, 100), np.full(300, 0.08)])
        lengths = [step(end, frame(k, y)) for k, y in enumerate(path)]
        assert (lengths[340].mode == Mode.BENDING).all()
        expected = BendingCurve().strain(-0.3, 0.01)[0]
        np.testing.assert_allclose(lengths[340].length_m / 0.17 - 1, expected, atol=0.03)
        assert (lengths[-1].mode == Mode.STRETCHING).all()

    def test_sigma_spans_both_modes_near_zero_strain(self, model: SensorModel) -> None:
        end = front_end(model, rest_strain=0.05)
        sure = [step(end, frame(k, 0.043)) for k in range(60)][-1]
        doubtful = [step(end, frame(k, -0.003)) for k in range(60, 160)][-1]
        assert (doubtful.flags & Flag.AMBIGUOUS).all()
        assert (doubtful.sigma_m > 3 * sure.sigma_m).all()

    def test_no_impossible_length_is_a_choice(self, model: SensorModel) -> None:
        """A sensor whose reading jumps as no strip's can has impossible strains as a stretched one: down to -200 %."""
        end = front_end(model, rest_strain=0.01)
        rng = np.random.default_rng(0)
        asked = 0
        for k in range(400):
            jump = rng.choice([0.0, -0.05, -0.5, 1.0, 5.0], size=4)
            modes = step(end, frame(k, 0.005 if k < 60 else jump)).modes
            if modes is None:
                continue
            impossible = is_impossible_length(modes.length_m, np.full(4, 0.17)).any(axis=0)
            asked += impossible.sum()
            assert not (impossible & is_mode_uncertain(modes.bending_probability)).any()
        assert asked > 0

    @settings(max_examples=25, deadline=None)
    @given(seed=st.integers(0, 2**32 - 1), cuts=st.lists(st.integers(1, 89), max_size=6))
    def test_many_frames_at_a_time_give_the_same_numbers(self, model: SensorModel, seed: int, cuts: list[int]) -> None:
        """Motion, bending, readings that are missing for some frames or seconds, and frames that are not there."""
        rng = np.random.default_rng(seed)
        change = 0.05 + np.cumsum(0.01 * rng.standard_normal((90, 4)), axis=0)
        change[:30] = 0.05 + 0.001 * rng.standard_normal((30, 4))
        for _ in range(4):
            first, tendon = rng.integers(90), rng.integers(4)
            change[first : first + rng.integers(1, 40), tendon] = np.nan
        number = np.arange(90) + 30 * (np.arange(90) > rng.integers(30, 90))
        frames = [frame(k, y) for k, y in zip(number.tolist(), change, strict=True)]
        one_by_one = front_end(model, rest_strain=0.03, rest_s=0.5)
        expected = [step(one_by_one, one) for one in frames]
        end = front_end(model, rest_strain=0.03, rest_s=0.5)
        bounds = [0, *sorted(set(cuts)), 90]
        told = [lengths for first, last in pairwise(bounds) for lengths in end.lengths(frames[first:last])]
        for one, other in zip(told, expected, strict=True):
            assert one.t_s == other.t_s
            np.testing.assert_array_equal(one.flags, other.flags)
            np.testing.assert_array_equal(one.mode, other.mode)
            for name in ("length_m", "sigma_m", "rest_sigma_m", "change_since_rest"):
                np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(one.drift.per_change_m, other.drift.per_change_m, atol=1e-12)
            np.testing.assert_allclose(one.model_error.after_motion, other.model_error.after_motion, atol=1e-12)
            assert (one.modes is None) == (other.modes is None)
            if one.modes is not None:
                np.testing.assert_allclose(one.modes.length_m, other.modes.length_m, atol=1e-12)
                np.testing.assert_allclose(one.modes.sigma_m, other.modes.sigma_m, atol=1e-12)

    @pytest.mark.parametrize("bad", [[np.nan], [np.nan] * 10, [np.nan] * 60])
    def test_gaps_never_poison_the_state(self, model: SensorModel, bad) -> None:
        clean, hurt = front_end(model), front_end(model)
        path = np.concatenate([np.full(100, 0.08), 0.08 + 0.03 * np.sin(np.linspace(0, 9, 600))])
        for k, y in enumerate(path):
            expected = step(clean, frame(k, y))
            change = np.full(4, y)
            if 300 <= k < 300 + len(bad):
                change[1] = np.nan
            lengths = step(hurt, frame(k, change))
            if np.isnan(change[1]):
                assert np.isnan(lengths.length_m[1])
                assert np.isinf(lengths.sigma_m[1])
                assert lengths.flags[1] & Flag.MISSING
        assert np.isfinite(lengths.length_m).all()
        assert abs(lengths.length_m[1] - expected.length_m[1]) < 0.0005
        np.testing.assert_allclose(lengths.length_m[[0, 2, 3]], expected.length_m[[0, 2, 3]], atol=1e-12)

    def test_a_sensor_back_from_a_long_gap_warms_up(self, model: SensorModel) -> None:
        end = front_end(model)
        for k in range(100):
            step(end, frame(k, 0.08))
        for k in range(100, 200):
            step(end, frame(k, [0.08, np.nan, 0.08, 0.08]))
        back = step(end, frame(200, 0.08))
        assert back.flags[1] & Flag.WARMING_UP
        assert back.sigma_m[1] > 1.1 * back.sigma_m[0]
        assert back.flags[0] == 0

    @pytest.mark.parametrize("gap", [20, 105])
    def test_what_moved_in_a_gap_is_no_rate(self, model: SensorModel, gap: int) -> None:
        """A step of dR/R within one frame would lag by a tenth of dR/R, and be bent; this one took the whole gap."""
        end = front_end(model)
        for k in range(150):
            taut = step(end, frame(k, 0.12))
        for k in range(150, 150 + gap):
            step(end, frame(k, np.nan))
        back = step(end, frame(150 + gap, 0.05))
        assert (back.mode == Mode.STRETCHING).all()
        assert (back.length_m < taut.length_m).all()
        for k in range(151 + gap, 156 + gap):
            assert (np.abs(step(end, frame(k, 0.05)).length_m - back.length_m) < 2 * back.sigma_m).all()

    def test_readings_beyond_training_are_flagged_and_widened(self, model: SensorModel) -> None:
        end = front_end(model)
        for k in range(60):
            usual = step(end, frame(k, 0.08))
        beyond = [step(end, frame(k, y)) for k, y in enumerate(np.linspace(0.08, 2.6, 200), start=60)][-1]
        assert (beyond.flags & Flag.OUT_OF_RANGE).all()
        assert (beyond.sigma_m > 10 * usual.sigma_m).all()

    def test_a_length_that_no_tendon_has_is_left_out(self, model: SensorModel) -> None:
        """A resistance near zero would be a strip without length."""
        end = front_end(model)
        for k in range(60):
            step(end, frame(k, 0.08))
        shorted = [step(end, frame(k, [0.08, y, 0.08, 0.08])) for k, y in enumerate(np.linspace(0.08, -0.99, 50), 60)][
            -1
        ]
        assert np.isnan(shorted.length_m[1])
        assert np.isinf(shorted.sigma_m[1])
        assert shorted.flags[1] & Flag.OUT_OF_RANGE
        assert np.isfinite(shorted.length_m[[0, 2, 3]]).all()

    def test_a_length_of_which_nothing_is_known_is_left_out(self, model: SensorModel) -> None:
        """Far beyond the recordings sigma was kilometres: more than any length that a tendon may have tells nothing."""
        end = front_end(model)
        for k in range(60):
            step(end, frame(k, 0.08))
        noise = np.random.default_rng(0).uniform(-0.9, 30, (200, 4))
        left_out = 0
        for k, change in enumerate(noise, start=60):
            lengths = step(end, frame(k, change))
            unknown = np.isinf(lengths.sigma_m)
            left_out += unknown.sum()
            assert (lengths.sigma_m[~unknown] <= 20 * 0.17).all()
            assert np.isnan(lengths.length_m[unknown]).all()
            assert (lengths.flags[unknown] & Flag.OUT_OF_RANGE).all()
        assert left_out > 400

    def test_too_fast_is_flagged_and_widened(self, model: SensorModel) -> None:
        end = front_end(model)
        for k in range(60):
            usual = step(end, frame(k, 0.08))
        fast = step(end, frame(60, 0.15))
        assert (fast.flags & Flag.TOO_FAST).all()
        assert (fast.sigma_m > 1.5 * usual.sigma_m).all()

    def test_without_rest_shape_all_sensors_warm_up(self, model: SensorModel) -> None:
        end = front_end(model, rest_strain=None)
        first, last = step(end, frame(0, 0.08)), [step(end, frame(k, 0.08)) for k in range(1, 600)][-1]
        assert (first.flags & Flag.WARMING_UP).all()
        assert not (last.flags & Flag.WARMING_UP).any()
        assert (last.sigma_m < first.sigma_m).all()

    def test_a_unified_network_measures_bent_tendons_too(self, model: SensorModel) -> None:
        """The same weights called unified: bent, the length is no longer the polynomial's; stretched it is the same."""
        unified = replace(model, unified=True)
        split_end, unified_end = front_end(model), front_end(unified)
        for k, y in enumerate(np.linspace(0.08, -0.4, 200)):
            split, one = step(split_end, frame(k, y)), step(unified_end, frame(k, y))
            if k == 20:
                np.testing.assert_array_equal(split.length_m, one.length_m)
        assert (one.mode == Mode.BENDING).all()
        assert (np.abs(split.length_m - one.length_m) > 1e-3).all()

    def test_a_model_without_bending_recordings_uses_the_paper_s_curve(self, model: SensorModel) -> None:
        bare = replace(model, bending=None)
        paper, own = bare.bending_curve("strain"), model.bending_curve("strain")
        assert paper.change(-0.4) == BendingCurve().change(-0.4)
        assert own.change(-0.4) != paper.change(-0.4)
        np.testing.assert_allclose(own.change([-0.2, -0.4, -0.7]), paper.change([-0.2, -0.4, -0.7]), atol=0.02)

    def test_both_readings_of_eq_9_run(self, model: SensorModel) -> None:
        ends = []
        for abscissa in ("strain", "resistance"):
            end = front_end(model, bending_abscissa=abscissa)
            ends.append([step(end, frame(k, y)) for k, y in enumerate(np.linspace(0.08, -0.5, 300))][-1].length_m[0])
        assert abs(ends[0] - ends[1]) > 0.005

    @settings(max_examples=15, deadline=None)
    @given(st.lists(st.floats(-0.99, 5.0) | st.just(float("nan")), min_size=5, max_size=60))
    def test_whatever_comes_lengths_are_finite_or_missing(self, path) -> None:
        end = front_end(read_sensor_model())
        for k, y in enumerate(path):
            lengths = step(end, frame(k, y))
            is_left_out = np.isnan(y) or not lengths.usable[0]
            assert np.isfinite(lengths.length_m[0]) == (not is_left_out)
            assert not is_left_out or lengths.flags[0] & (Flag.MISSING | Flag.OUT_OF_RANGE)
            assert is_left_out or 0 < lengths.length_m[0] < 20 * 0.17
            assert not np.isnan(lengths.sigma_m).any()
            assert (lengths.sigma_m > 0).all()


@pytest.mark.parametrize("codes", [0.35, 1.0, 2.0])
def test_noise_of_the_converter_is_no_shaking(model: SensorModel, codes: float) -> None:
    """One code is 0.004 of dR/R where both resistors of a divider are equal; a minute at rest, on 24 sensors."""
    change = model.gauge.change(np.full(24, 0.08), BendingCurve())
    noise = 0.004 * codes * np.random.default_rng(16).standard_normal((3000, 24))
    frames = [
        ResistanceFrame(0.02 * k, 6e6 * (1 + change + row), np.full(24, 6e3), np.zeros(24, dtype=np.int64))
        for k, row in enumerate(noise)
    ]
    lengths = front_end(model, count=24, rest_s=2.0).lengths(frames)
    shaken = np.array([of_frame.flags & int(Flag.SHAKEN) != 0 for of_frame in lengths])
    assert shaken.mean() < 0.1
    assert np.mean(shaken.mean(axis=1) > 0.4) < 0.01  # else the robot counts as shaken


def test_motion_while_it_is_tared_widens_sigma_for_good(model: SensorModel) -> None:
    """The lengths of all tendons change by 3 mm in the second of rest: half of that is in sigma, and it is said."""
    change = np.where(np.arange(50) < 25, 0.08, 0.08 + 0.003 / 0.17 * model.gauge.slope(np.zeros(1))[0])
    moved, still = front_end(model), front_end(model)
    for k in range(200):
        widened = step(moved, frame(k, change[min(k, 49)]))
        as_usual = step(still, frame(k, 0.08))
    assert moved.moved_at_rest
    assert not still.moved_at_rest
    assert widened.sigma_m.min() > 0.001
    assert as_usual.sigma_m.max() < 0.001
