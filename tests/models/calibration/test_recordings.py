"""Which recordings train, validate and test."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strips import T_S, triangle
from tensegraph import InputError
from tensegraph.models.calibration.recordings import Recording, Split


class TestSplit:
    def test_speed_of_a_recording(self) -> None:
        assert triangle("a", 0.05).speed_per_s == pytest.approx(0.05)
        slow = triangle("a", 0.02)
        noise = 5e-4 * np.random.default_rng(1).standard_normal(len(slow.strain))  # half as much as a step
        assert replace(slow, strain=slow.strain + noise).speed_per_s == pytest.approx(0.02, rel=0.02)
        rng = np.random.default_rng(0)
        wandering = Recording("b", T_S, np.interp(T_S, np.arange(61), rng.uniform(0, 0.2, 61)), T_S)
        assert np.isnan(wandering.speed_per_s)

    def test_the_middle_speed_is_held_out_whole(self) -> None:
        recordings = [triangle(f"s{speed}_{k}", speed) for speed in (0.01, 0.05, 0.2) for k in range(2)]
        split = Split.by_recordings(recordings)
        assert [r.name for r in split.held_out] == ["s0.05_0", "s0.05_1"]
        assert not {r.name for r in split.training} & {r.name for r in split.held_out}

    def test_nothing_to_train_on_or_to_score_is_refused(self) -> None:
        """The first 10 s are for settling: of 60 s, a tenth ends before; and what only bends has no score."""
        with pytest.raises(
            InputError, match=r"recording a: expected more than its first 10 s to train on, got 5\.05 s"
        ):
            Split.by_time([triangle("a", 0.05)], 0.9)
        split = Split.by_name([triangle("a", 0.05), triangle("bend", 0.05, high=-0.2)], ["bend"])
        assert [r.name for r in split.scored(unified=True)] == ["bend"]
        with pytest.raises(InputError, match=r"held out: expected stretching later than 10 s in one of them, .* bend"):
            split.scored(unified=False)

    def test_one_recording_is_split_in_time(self) -> None:
        """70 % of 60 s train and validate, the last 15 % of these validate; no sample does two things."""
        split = Split.by_recordings([triangle("only", 0.05)])
        (training,), (validation,), (held_out,) = split.training, split.validation, split.held_out
        assert training.t_s[-1] <= validation.scored_from_s < validation.t_s[-1] <= held_out.scored_from_s
        assert held_out.scored_from_s == pytest.approx(0.7 * 60, abs=0.1)
        assert validation.scored_from_s == pytest.approx(0.85 * 0.7 * 60, abs=0.1)

    @given(st.integers(1, 30), st.integers(1, 4))
    def test_no_recording_is_used_twice(self, irregular: int, speeds: int) -> None:
        rng = np.random.default_rng(irregular)
        t_s = np.arange(0, 40, 0.5)
        recordings = [
            Recording(f"r{k:02}", t_s, np.interp(t_s, np.arange(41), rng.uniform(0, 0.2, 41)), t_s)
            for k in range(irregular)
        ]
        recordings += [triangle(f"s{k}", 0.01 * 2**k, t_s=t_s) for k in range(speeds)]
        split = Split.by_recordings(recordings)
        for r in split.held_out:
            before = [x for x in (*split.training, *split.validation) if x.name == r.name]
            assert all(x.t_s[-1] <= r.scored_from_s for x in before)
        for r in split.validation:
            assert all(x.t_s[-1] <= r.scored_from_s for x in split.training if x.name == r.name)
        assert split.training
        assert split.held_out

    def test_a_pattern_that_fits_nothing_is_refused(self) -> None:
        with pytest.raises(InputError, match=r"--hold-out x\*: fits no recording"):
            Split.by_name([triangle("a", 0.05)], ["x*"])
        with pytest.raises(InputError, match="no recording of stretching to train on"):
            Split.by_name([triangle("a", 0.05)], ["a"])
