"""Rows of lengths that pause while other sensors of a robot on a floor go on, and samples that are missing."""

import tomllib

import numpy as np
import pytest
import tomli_w

from pipelines import pipeline_of
from roll import ROLL, roll
from tensegraph import Trial, open_trial, reconstruct
from tensegraph.models.evaluation.metrics import node_rmse_m

PAUSE_S = (3.5, 5.0)
END_S = 5.4


@pytest.fixture(scope="module")
def paused(tmp_path_factory) -> Trial:
    """The example until after its first tip, with true lengths in place of counts, which pause during the tip."""
    folder = roll(tmp_path_factory.mktemp("paused") / "trial", END_S)
    truth = open_trial(ROLL).truth()
    told = tomllib.loads((folder / "trial.toml").read_text())
    for key in ("adc", "sensors", "board"):
        del told[key]
    (folder / "trial.toml").write_text(tomli_w.dumps(told | {"lengths": {"file": "lengths.csv"}}))
    structure = open_trial(ROLL).description.structure
    read = (truth.t_s < END_S) & ((truth.t_s < PAUSE_S[0]) | (truth.t_s > PAUSE_S[1]))
    length_m = structure.tendon_length_m(truth.node_position_m[read])
    length_m += np.random.default_rng(0).normal(0, 3e-4, length_m.shape)
    header = ",".join(["t_s", *(f"l{e}_m" for e in range(length_m.shape[1]))])
    table = np.column_stack([truth.t_s[read], length_m])
    np.savetxt(folder / "lengths.csv", table, delimiter=",", header=header, comments="", fmt="%.6f")
    return open_trial(folder)


def test_frames_go_on_at_their_rate_with_what_is_read(paused) -> None:
    """A robot in a hand, or on anchors, has no frames there: nothing tells how it moves."""
    frames = list(pipeline_of(paused.description).lengths(paused.readings()))
    in_pause = [frame for frame in frames if PAUSE_S[0] < frame.t_s < PAUSE_S[1]]
    assert len(in_pause) == pytest.approx(75, abs=2)
    assert not any(frame.usable.any() for frame in in_pause)
    t_s = np.array([frame.t_s for frame in frames])
    assert (np.diff(t_s) > 0.005).all()
    for frame in in_pause:
        assert all(frame.t_s - 0.06 < aid.t_s <= frame.t_s for aid in frame.aids)


@pytest.mark.parametrize("method", ["live", "batch"])
def test_a_tip_in_a_pause_is_followed(paused, method) -> None:
    truth = paused.truth()
    assert 1e3 * node_rmse_m(reconstruct(paused, method), truth.t_s, truth.node_position_m) < 15


def test_samples_that_are_missing_for_a_tenth_of_a_second_in_an_impact_cost_little(tmp_path) -> None:
    """At 3.99 s the robot falls onto its next face. It was 170 mm off from then on, and the sensor was given up."""
    folder = roll(tmp_path / "trial", 4.6)
    header, *rows = (folder / "imu0.csv").read_text().splitlines(keepends=True)
    read = [row for row in rows if not 3.99 <= float(row.split(",")[0]) < 4.09]
    assert len(rows) - len(read) == 10
    (folder / "imu0.csv").write_text(header + "".join(read))
    trial = open_trial(folder)
    truth, result = trial.truth(), reconstruct(trial, "live")
    assert 1e3 * node_rmse_m(result, truth.t_s, truth.node_position_m) < 15
    assert not any(result.doubts)
