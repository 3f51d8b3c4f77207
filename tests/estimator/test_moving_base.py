"""An anchored structure whose base moves all the same."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tensegraph import Status, open_trial, reconstruct
from tensegraph.models.structure.shape import Reason
from trial_edits import cut

ROLL = Path(__file__).parents[2] / "examples" / "roll_02"


@pytest.fixture(scope="module")
def told_anchored(tmp_path_factory):
    """The robot until its first tip, described as if the three nodes on which it starts were anchored."""
    folder = tmp_path_factory.mktemp("anchored") / "trial"
    shutil.copytree(ROLL, folder)
    cut(folder, until_s=5.0)
    rest_m = open_trial(ROLL).description.rest_position_m
    base = np.argsort(rest_m[:, 2])[:3]
    text = (folder / "trial.toml").read_text()
    text = text.replace("anchors = []", f"anchors = {base.tolist()}")
    text = text.replace("anchor_position_m = []", f"anchor_position_m = {rest_m[base].tolist()}")
    (folder / "trial.toml").write_text(text.replace("[ground]", "[was_ground]"))
    return open_trial(folder), base


def test_a_base_that_rolls_is_doubted_within_a_second(told_anchored) -> None:
    trial, base = told_anchored
    truth = trial.truth()
    lifted = (truth.node_position_m[:, base, 2] - truth.node_position_m[0, base, 2]).max(axis=1) > 0.03
    tipped_s = truth.t_s[np.argmax(lifted)]
    result = reconstruct(trial, "live")
    doubted = np.array([doubt is Reason.BASE for doubt in result.doubts])
    first_s = result.t_s[np.argmax(doubted)]
    assert tipped_s - 0.5 < first_s < tipped_s + 1.0
    assert not doubted[result.t_s < 2.5].any()
    assert {result.status[k] for k in np.flatnonzero(doubted)} == {Status.DOUBT}
    free = result.structure.free_nodes
    assert result.node_sigma_m[doubted][:, free].min() > 0.3
