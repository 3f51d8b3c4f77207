"""A load that stays, as none does that a hand makes: the sensors were tared while somebody touched the structure."""

from dataclasses import replace

import numpy as np
import pytest

from one_hand import NODE, Hand
from pipelines import pipeline_of
from plan_edits import PLANS, SHORT, replaced
from tensegraph import Status, simulate
from tensegraph.estimator.watches.steady_load import SteadyLoad
from tensegraph.models.structure.shape import Reason

FINGER_N = 1.5
LONGER = (("duration_s = 6.0", "duration_s = 18.0"), ("until_s = 6.0", "until_s = 18.0"))
TOUCHED = """
[[load.press]]
at_s = 0.0
ramp_s = 0.1
hold_s = 2.3
nodes = [5]
force_n = 1.0
direction = [0.3, 0.0, -1.0]
during_rest = true
"""


@pytest.fixture
def hand(balanced, lengths_of) -> Hand:
    return Hand(SteadyLoad(balanced, FINGER_N), balanced, lengths_of)


def test_a_load_that_pulls_up_between_all_presses_raises_the_doubt(hand) -> None:
    """Presses with 2 N on top of 0.6 N; 20 means of half a second are needed, of which 0.35 are the same."""
    found = []
    for _ in range(6):
        hand.load(0.6, 1.5)
        hand.load(-1.4, 0.5)
        found.append(hand.load(0.6, 0.5).doubt)
    assert found[:3] == [None] * 3
    assert found[-2:] == [Reason.REST] * 2
    assert hand.load(-1.4, 1.0).doubt is Reason.REST  # also while it is pressed


def test_the_ellipsoid_grows_by_the_deformation_without_other_loads(hand) -> None:
    """4 mm along z, at a node whose standard deviation was 1 mm: sqrt(4^2 + 1^2) mm."""
    hand.load(0.6, 12.0, moved_m=0.004)
    shape = hand.load(-1.4, 0.2, moved_m=-0.010)
    assert (shape.status, shape.doubt) == (Status.DOUBT, Reason.REST)
    variance_m2 = np.diag(shape.node_covariance_m2[NODE])
    np.testing.assert_allclose(variance_m2, [1e-6, 1e-6, 17e-6], rtol=1e-6)


@pytest.mark.parametrize("force_n", [-0.6, 0.2], ids=["weight", "small"])
def test_a_weight_and_a_small_load_raise_no_doubt(hand, force_n) -> None:
    assert hand.load(force_n, 20.0).doubt is None


def test_long_presses_upwards_raise_no_doubt(hand) -> None:
    """Half of the time each; a hand that lets go leaves no load."""
    assert {hand.load(force_n, 3.0).doubt for force_n in (0.6, 0.0) * 5} == {None}


def test_the_doubt_ends_when_the_load_does(hand) -> None:
    assert hand.load(0.6, 12.0).doubt is Reason.REST
    assert hand.load(0.0, 8.0).doubt is None


def test_lengths_that_are_told_are_not_tared(hand) -> None:
    hand.lengths = replace(hand.lengths, of_strips=False)
    assert hand.load(0.6, 20.0).doubt is None


def test_a_press_during_all_of_the_rest_is_found_out(tmp_path) -> None:
    """In batch in all frames; most nodes are in their ellipsoids then."""
    plan = tmp_path / "touched.toml"
    plan.write_text(replaced(PLANS["press"].read_text(), *SHORT, *LONGER) + TOUCHED)
    trial = simulate(plan, tmp_path / "trial", 14)
    pipeline = pipeline_of(trial.description)
    frames = list(pipeline.lengths(trial.readings(), 500))
    assert {shape.doubt for shape in pipeline.shapes(frames, "batch")} == {Reason.REST}
    live = [shape.doubt for shape in pipeline.shapes(frames, "live")]
    assert live[0] is None
    assert live[-1] is Reason.REST
