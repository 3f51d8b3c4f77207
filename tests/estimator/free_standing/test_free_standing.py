"""A free-standing structure: ten seconds in which a robot with one inertial sensor is tipped onto other faces."""

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from roll import ROLL, roll, soon_tipped
from tensegraph import InputError, evaluate, open_trial, reconstruct
from tensegraph.models.evaluation import metrics
from tensegraph.models.structure.lengths import member_length_m
from tensegraph.models.structure.shape import Reason, Status
from trial_edits import lines, rewritten


@pytest.fixture(scope="module", params=["live", pytest.param("batch", marks=pytest.mark.long)])
def rolled(request, tmp_path_factory):
    """The reconstruction of the shipped trial until both tips are over, and its evaluation.

    The first tip is from 3.5 to 4 s, the second one from 6.5 to 8 s.
    """
    trial = open_trial(roll(tmp_path_factory.mktemp("rolled") / "roll_02", 9.0))
    reconstruction = reconstruct(trial, request.param)
    truth = trial.truth_of(trial.truth(), trial.true_loads())
    return reconstruction, metrics.evaluate(trial.description.rest_position_m, reconstruction, truth)


def test_the_robot_is_followed(rolled) -> None:
    """What the README promises, with room for another trial: two tips over a third of a metre."""
    _, evaluation = rolled
    pose = evaluation.pose
    assert pose.path_m > 0.3
    assert pose.shape_rmse_m < 0.7 * pose.held_rmse_m
    assert pose.still_tilt_rms_deg < 0.5
    assert pose.tilt_rms_deg < 2.5
    assert pose.drift_share < 0.05
    assert pose.contacts.precision > 0.9
    assert pose.contacts.recall > 0.95
    assert evaluation.consistency.coverage_95 > 0.85


def test_rods_keep_their_length_and_nothing_sinks(rolled) -> None:
    reconstruction, _ = rolled
    a, b = reconstruction.structure.rods.T
    x = reconstruction.node_position_m
    assert np.linalg.norm(x[:, a] - x[:, b], axis=2) == pytest.approx(0.3, abs=0.001)
    assert x[..., 2].min() > 0.0


def test_the_track_starts_sure_and_grows_unsure(rolled) -> None:
    reconstruction, _ = rolled
    sigma_m = np.sqrt(np.trace(reconstruction.centroid_covariance_m2[:, :2, :2], axis1=1, axis2=2))
    assert sigma_m[:50].max() < 0.003
    assert sigma_m[-1] > 2 * sigma_m[:50].max()
    assert np.linalg.eigvalsh(reconstruction.node_covariance_m2).min() > 0


def without(folder: Path, *tables: str, until_s: float = np.inf) -> Path:
    """Return a copy of the trial, or of its beginning, without some tables of trial.toml."""

    def edit(text: str) -> str:
        return "\n[".join(part for part in text.split("\n[") if not part.lstrip("[").startswith(tables))

    return soon_tipped(folder, until_s, edit)


@pytest.mark.parametrize("method", ["live", "batch"])
def test_without_a_floor_gravity_has_no_direction(method, tmp_path) -> None:
    """A rest shape that is told upside down gives the same shapes upside down."""
    upright = without(tmp_path / "upright", "ground", "imu", until_s=1.8)
    turned = tmp_path / "turned"
    shutil.copytree(upright, turned)
    told = tomllib.loads((turned / "trial.toml").read_text())
    over = np.array([1.0, -1.0, -1.0])
    told["rest"]["node_position_m"] = (over * np.array(told["rest"]["node_position_m"])).tolist()
    (turned / "trial.toml").write_text(tomli_w.dumps(told))
    one, other = (reconstruct(trial, method).node_position_m for trial in (upright, turned))
    np.testing.assert_allclose(other, over * one, atol=1e-5)


def test_without_a_floor_the_shape_is_described_in_body_coordinates(tmp_path) -> None:
    """Held in a hand: the frame is that of the rest shape, and the covariance is that of the shape alone."""
    trial = open_trial(without(tmp_path / "hand", "ground", "imu", until_s=3.0))
    body = reconstruct(trial, "live")
    assert body.contacts is None
    assert np.abs(body.centroid_m - body.centroid_m[0]).max() < 0.005
    assert np.median(body.node_sigma_m) < 0.004
    score = evaluate(body, trial)  # of the shape alone: the robot has tipped, and nothing tells it
    assert score.in_body
    assert score.absolute.nodes.rmse_m < 0.003
    assert score.pose.shape_rmse_m == pytest.approx(score.absolute.nodes.rmse_m)
    assert np.isnan(score.pose.tilt_rms_deg)


@pytest.mark.parametrize("until_s", [2.8, pytest.param(7.0, marks=pytest.mark.long)], ids=["one tip", "two tips"])
def test_without_any_aid_it_is_followed_too(until_s, tmp_path) -> None:
    trial = open_trial(without(tmp_path / "bare", "imu", until_s=until_s))
    pose = evaluate(reconstruct(trial, "batch"), trial).pose
    assert pose.contacts.still_precision > 0.95
    assert pose.still_tilt_rms_deg < 2.0
    assert pose.drift_share < 0.06


@pytest.mark.parametrize("until_s", [1.7, pytest.param(6.0, marks=pytest.mark.long)], ids=["one tip", "two tips"])
def test_another_resting_face_is_told_as_a_second_shape(until_s, tmp_path) -> None:
    """Live, without any aid, which face it rests on is not sure in a tip: the same shape on two faces is told."""
    trial = open_trial(without(tmp_path / "bare", "imu", until_s=until_s))
    found = reconstruct(trial, "live")
    told = [k for k, status in enumerate(found.status) if status == Status.TWO_SHAPES and found.t_s[k] > until_s - 0.3]
    assert len(told) > 5
    one_m = found.node_position_m[told]
    other_m = np.array([found.others[k].node_position_m for k in told])
    tendons = trial.description.structure.tendons
    np.testing.assert_allclose(member_length_m(one_m, tendons), member_length_m(other_m, tendons), atol=1e-9)
    if until_s > 2:
        truth = trial.truth()
        true_m = truth.node_position_m[np.searchsorted(truth.t_s, found.t_s[told])]
        error_m = [np.linalg.norm(x - true_m, axis=2).mean(axis=1) for x in (one_m, other_m)]
        assert error_m[0].max() > 0.1
        assert np.minimum(*error_m).max() < 0.025


@pytest.mark.parametrize("method", ["frame", "least-squares", "ukf"])
def test_methods_for_anchored_structures_are_refused(method) -> None:
    with pytest.raises(InputError, match="expected one of batch, live for a structure without anchors"):
        reconstruct(ROLL, method)


def test_a_sensor_told_the_wrong_way_round_is_named_and_left_out(tmp_path) -> None:
    path = soon_tipped(tmp_path / "wrong", 2.8, lambda text: text.replace("axis = [0, 0, 1]", "axis = [0, 0, -1]"))
    result = reconstruct(path, "live")
    assert np.mean([doubt is Reason.IMU for doubt in result.doubts]) > 0.5
    assert np.isfinite(result.node_position_m).all()
    assert np.abs(result.centroid_m).max() < 1.0


def test_a_sensor_that_is_slower_than_the_frames_is_felt_in_all_of_them(tmp_path) -> None:
    """Means of three samples, 33 a second: frames between them were taken for those of a robot without a sensor."""
    path = soon_tipped(tmp_path / "slow", 7.0)
    header, *rows = (path / "imu0.csv").read_text().splitlines()
    samples = np.array([row.split(",") for row in rows], dtype=float)[: len(rows) // 3 * 3].reshape(-1, 3, 7)
    samples = np.column_stack([samples[:, -1, 0], samples[:, :, 1:].mean(axis=1)])
    (path / "imu0.csv").write_text("\n".join([header, *(",".join(f"{x:.4f}" for x in row) for row in samples), ""]))
    trial = open_trial(path)
    evaluation = evaluate(reconstruct(trial, "live"), trial)
    assert evaluation.pose.tilt_rms_deg < 3
    assert evaluation.consistency.coverage_95 > 0.8


def stuck(rows: list[str]) -> list[str]:
    """Return the lines of a sensor that repeats one sample from a second on."""
    values = rows[100].split(",", 1)[1]
    return rows[:100] + [f"{row.split(',')[0]},{values}" for row in rows[100:]]


FAULTS = [
    pytest.param(stuck, 2.8, id="stuck"),
    pytest.param(stuck, 7.0, id="stuck, two tips", marks=pytest.mark.long),
    pytest.param(lambda rows: rows[:100], 4.0, id="ended", marks=pytest.mark.long),
]


@pytest.mark.parametrize(("fault", "until_s"), FAULTS)
def test_without_its_sensor_the_robot_is_followed_by_the_balance_of_forces(fault, until_s, tmp_path) -> None:
    """The sensor fails after one second, before the first tip; in the longer trial it misses the second, too."""
    path = soon_tipped(tmp_path / "failed", until_s)
    rewritten(path / "imu0.csv", lines(fault))
    trial = open_trial(path)
    pose = evaluate(reconstruct(trial, "live"), trial).pose
    assert pose.still_tilt_rms_deg < 2.0
    assert pose.contacts.still_precision > 0.9


def test_without_mechanics_contacts_are_told_by_heights(tmp_path) -> None:
    path = without(tmp_path / "no_mechanics", "mechanics", until_s=2.8)
    trial = open_trial(path)
    pose = evaluate(reconstruct(trial, "live"), trial).pose
    assert pose.still_tilt_rms_deg < 3.0


@pytest.mark.parametrize("method", ["live", pytest.param("batch", marks=pytest.mark.long)])
def test_without_mechanics_it_rests_on_the_face_that_its_sensor_told_last(method, tmp_path) -> None:
    """The sensor ends after two tips onto other faces: the robot was put back onto its first one, 0.3 m wrong."""
    path = without(tmp_path / "ends", "mechanics", until_s=6.9)
    samples = (path / "imu0.csv").read_text().splitlines(keepends=True)
    (path / "imu0.csv").write_text("".join(samples[:660]))
    trial = open_trial(path)
    result = reconstruct(trial, method)
    last = np.searchsorted(trial.truth().t_s, result.t_s[-1] - 1e-6)
    apart_m = result.node_position_m[-1] - trial.truth().node_position_m[last]
    assert np.sqrt(np.mean(np.sum(apart_m**2, axis=1))) < 0.05
