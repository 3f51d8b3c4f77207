"""An anchored structure whose base moves all the same."""

from dataclasses import replace

import numpy as np
import pytest

from plan_edits import replaced
from roll import ROLL, soon_tipped
from tensegraph import Settings, Status, open_trial, reconstruct
from tensegraph.estimator.rest.rest_step import rest_shape_of
from tensegraph.estimator.watches.moving_base import MovingBase
from tensegraph.models.structure.shape import Reason, Shape
from tensegraph.models.values.aids import ImuReading


@pytest.fixture(scope="module")
def told_anchored(tmp_path_factory):
    """The robot until its first tip, described as if the three nodes on which it starts were anchored."""
    rest_m = open_trial(ROLL).description.rest_position_m
    base = np.argsort(rest_m[:, 2])[:3]
    edits = (
        ("anchors = []", f"anchors = {base.tolist()}"),
        ("anchor_position_m = []", f"anchor_position_m = {rest_m[base].tolist()}"),
        ("[ground]", "[was_ground]"),
    )
    folder = tmp_path_factory.mktemp("anchored") / "trial"
    return open_trial(soon_tipped(folder, 3.0, lambda text: replaced(text, *edits))), base


def test_a_base_that_rolls_is_doubted_within_a_second(told_anchored) -> None:
    trial, base = told_anchored
    truth = trial.truth()
    lifted = (truth.node_position_m[:, base, 2] - truth.node_position_m[0, base, 2]).max(axis=1) > 0.03
    tipped_s = truth.t_s[np.argmax(lifted)]
    result = reconstruct(trial, "live")
    doubted = np.array([doubt is Reason.BASE for doubt in result.doubts])
    first_s = result.t_s[np.argmax(doubted)]
    assert tipped_s - 0.5 < first_s < tipped_s + 1.0
    assert not doubted[result.t_s < 1.2].any()
    assert {result.status[k] for k in np.flatnonzero(doubted)} == {Status.DOUBT}
    free = result.structure.free_nodes
    assert result.node_sigma_m[doubted][:, free].min() > 0.3


class TestSilence:
    """An inertial sensor of a robot that stands still, whose readings are made here."""

    @pytest.fixture
    def watch(self, told_anchored):
        """Returns the shape at rest as it is after a time, with a reading unless the rate is nan."""
        description = told_anchored[0].description
        rest = rest_shape_of(description, Settings().rest)
        base = MovingBase(rest, description.imus, description.rest_seconds)
        at_rest = next(iter(reconstruct(told_anchored[0], "live")))
        samples = [one for one in told_anchored[0].readings() if isinstance(one, ImuReading) and one.t_s < 1.0]
        gravity = np.mean([one.specific_force_m_per_s2 for one in samples], axis=0)

        def observed(t_s: float, rate_rad_per_s: float, status: Status = Status.OK) -> Shape:
            reading = ImuReading(0, t_s, np.array([0.0, rate_rad_per_s, rate_rad_per_s]), gravity)
            aids = () if np.isnan(rate_rad_per_s) else (reading,)
            shape = replace(at_rest, t_s=t_s, status=status, doubt=None, node_position_m=rest.node_position_m)
            return base.observe(replace(shape, lengths=replace(shape.lengths, t_s=t_s, aids=aids)))

        for t_s in np.arange(0, description.rest_seconds + 0.1, 0.02):
            assert observed(t_s, 0.0).doubt is None
        self.start_s = t_s
        return observed

    def test_one_sample_after_it_does_not_turn_the_base(self, watch) -> None:
        """0.3 rad/s for 3 s would be 52 degrees; the sample tells of the time since the one before it alone."""
        after_s = self.start_s + 3.0
        assert watch(after_s, 0.3).doubt is None
        assert {watch(after_s + t_s, 0.0).doubt for t_s in np.arange(0.02, 1.0, 0.02)} == {None}

    def test_a_base_that_has_turned_is_doubted_through_it(self, watch) -> None:
        """And a worse status than `doubt` stands."""
        for t_s in np.arange(0.02, 1.0, 0.02):
            shape = watch(self.start_s + t_s, 0.5)
        assert shape.doubt is Reason.BASE
        assert watch(self.start_s + 2.0, np.nan).doubt is Reason.BASE
        assert watch(self.start_s + 4.0, 0.0).doubt is Reason.BASE
        assert watch(self.start_s + 4.02, 0.0, Status.NOT_CONVERGED).status is Status.NOT_CONVERGED

    def test_one_that_was_not_read_at_rest_tells_nothing(self, told_anchored) -> None:
        """Its bias is unknown: 0.03 rad/s, as of a cheap sensor, would turn the base by 17 degrees in 10 s."""
        description = told_anchored[0].description
        rest = rest_shape_of(description, Settings().rest)
        base = MovingBase(rest, description.imus[:1], description.rest_seconds)
        at_rest = next(iter(reconstruct(told_anchored[0], "live")))
        for t_s in np.arange(0, description.rest_seconds + 10, 0.02):
            reading = ImuReading(0, t_s, np.array([0.0, 0.03, 0.0]), np.array([0.0, 0.0, 9.81]))
            aids = (reading,) if t_s > description.rest_seconds + 1 else ()
            shape = replace(at_rest, t_s=t_s, doubt=None, node_position_m=rest.node_position_m)
            shape = base.observe(replace(shape, lengths=replace(shape.lengths, aids=aids)))
            assert shape.doubt is None

    def test_one_of_two_that_is_silent_does_not_hide_the_other(self, told_anchored) -> None:
        """The clock of the trial may start anywhere; the silent one was to be on another rod."""
        description = told_anchored[0].description
        rest = rest_shape_of(description, Settings().rest)
        other = replace(description.imus[0], rod=(description.imus[0].rod + 1) % 6)
        base = MovingBase(rest, [description.imus[0], other], description.rest_seconds)
        at_rest = next(iter(reconstruct(told_anchored[0], "live")))
        samples = [one for one in told_anchored[0].readings() if isinstance(one, ImuReading) and one.t_s < 1.0]
        gravity = np.mean([one.specific_force_m_per_s2 for one in samples], axis=0)
        for t_s in np.arange(0, description.rest_seconds + 1.5, 0.02):
            turning = t_s > description.rest_seconds + 0.2
            reading = ImuReading(0, 1e9 + t_s, np.array([0.0, 0.5, 0.5]) * turning, gravity)
            shape = replace(at_rest, t_s=1e9 + t_s, doubt=None, node_position_m=rest.node_position_m)
            shape = base.observe(replace(shape, lengths=replace(shape.lengths, aids=(reading,))))
        assert shape.doubt is Reason.BASE
