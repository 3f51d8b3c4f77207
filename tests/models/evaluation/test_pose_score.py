"""The score of a free-standing structure, worked by hand."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegraph import six_strut
from tensegraph.models.evaluation.evaluation import ComparedFrames
from tensegraph.models.evaluation.pose_score import _noise_m, _still, score_pose
from tensegraph.models.structure.form_finding import find_rest_shape
from tensegraph.models.values.rotations import rotation


@pytest.fixture(scope="module")
def rest_m() -> NDArray[np.float64]:
    return find_rest_shape(six_strut(0.3))


def compared(estimated_m, true_m, contacts=None) -> ComparedFrames:
    count = len(true_m)
    nothing = np.zeros((count, 12))
    return ComparedFrames(
        t_s=0.02 * np.arange(count),
        estimated_m=estimated_m,
        true_m=true_m,
        node_sigma_m=nothing,
        height_sigma_m=nothing,
        nees=nothing,
        node_error_m=estimated_m - true_m,
        face_error_m=np.zeros((count, 1, 3)),
        frame_error_m=np.zeros(count),
        wrong_branch=np.zeros(count, dtype=bool),
        estimated_load_n=None,
        true_load_n=None,
        contacts=contacts,
    )


def test_a_turn_and_a_shift_are_told_apart(rest_m) -> None:
    """The truth walks 1 m along x; the estimate is tilted by 2 degrees about x, turned by 3, and ends 50 mm aside.

    Without the turn each node is off by 2 sin(1 degree) times its distance from the axis through the centre along x.
    """
    shift_m = np.linspace(0, 1, 51)[:, None, None] * [1.0, 0, 0]
    true_m = rest_m + shift_m
    turn = rotation(np.deg2rad([0, 0, 3.0])) @ rotation(np.deg2rad([2.0, 0, 0]))
    centre = rest_m.mean(axis=0)
    estimated_m = (rest_m - centre) @ turn.T + centre + shift_m * [1, 0, 0] + [0, 0.05, 0]
    score = score_pose(compared(estimated_m, true_m), rest_m)
    assert score.path_m == pytest.approx(1.0)
    assert score.drift_share == pytest.approx(0.05)
    assert score.tilt_rms_deg == pytest.approx(2.0, abs=0.01)
    assert score.heading_error_deg == pytest.approx(3.0, abs=0.01)
    assert score.shape_rmse_m == pytest.approx(0.0, abs=1e-9)
    from_axis_m = np.linalg.norm((rest_m - centre)[:, 1:], axis=1)
    tilted_m = 2 * np.sin(np.deg2rad(1.0)) * np.sqrt(np.mean(from_axis_m**2))
    assert score.level_rmse_m == pytest.approx(tilted_m, rel=1e-3)
    assert np.isnan(score.still_tilt_rms_deg)


def test_a_rest_shape_that_is_only_moved_is_held_exactly(rest_m) -> None:
    """The truth tips by 40 degrees and goes 0.5 m, and nothing bends: all that holding the rest shape is to tell."""
    turn = np.stack([rotation(np.deg2rad([angle, 0, 0])) for angle in np.linspace(0, 40, 21)])
    true_m = rest_m @ np.swapaxes(turn, 1, 2) + np.linspace(0, 0.5, 21)[:, None, None]
    assert score_pose(compared(true_m, true_m), rest_m).held_rmse_m == pytest.approx(0.0, abs=1e-9)


def tipped(rest_m) -> ComparedFrames:
    """A robot that stands for 4 s, goes 0.3 m within 2 s, and stands for 4 s; 30 mm aside at the end."""
    t_s = 0.02 * np.arange(500)
    gone = np.clip((t_s - 4.0) / 2.0, 0, 1)[:, None, None]
    true_m = rest_m + gone * [0.3, 0, 0]
    return compared(true_m + gone * [0, 0.03, 0], true_m)


@pytest.mark.parametrize("seed", range(5))
def test_noise_of_the_truth_is_no_path_and_no_motion(rest_m, seed) -> None:
    """With 0.5 mm of it at each node, frame by frame, the path was 0.43 m, and no frame was still."""
    exact = tipped(rest_m)
    noise_m = 0.0005 * np.random.default_rng(seed).standard_normal(exact.true_m.shape)
    clean = score_pose(exact, rest_m)
    noisy = score_pose(replace(exact, true_m=exact.true_m + noise_m), rest_m)
    assert clean.path_m == pytest.approx(0.3, abs=1e-9)
    assert clean.drift_share == pytest.approx(0.1, abs=1e-9)
    assert noisy.path_m == pytest.approx(clean.path_m, rel=0.1)
    assert noisy.drift_share == pytest.approx(clean.drift_share, rel=0.1)
    assert np.isfinite(noisy.still_tilt_rms_deg)


@pytest.mark.parametrize("noise_m", [0.0, 0.0005, 0.001])
def test_which_frames_are_still(rest_m, noise_m) -> None:
    """Those of the 4 s before it goes and of the 4 s after, but for the time over which speeds are averaged."""
    exact = tipped(rest_m)
    noise = noise_m * np.random.default_rng(3).standard_normal(exact.true_m.shape)
    still = _still(exact.t_s, exact.true_m + noise)
    assert still[:185].all()
    assert still[315:].all()
    assert not still[205:295].any()


def test_the_noise_of_a_coordinate_is_measured_while_the_robot_stands(rest_m) -> None:
    """The third difference of 1 mm is 4.5 mm, of a constant speed nothing."""
    exact = tipped(rest_m)
    noise_m = 0.001 * np.random.default_rng(0).standard_normal(exact.true_m.shape)
    assert _noise_m(exact.t_s, exact.true_m) < 1e-6
    assert _noise_m(exact.t_s, exact.true_m + noise_m) == pytest.approx(0.001, rel=0.1)
    assert _noise_m(exact.t_s[:3], noise_m[:3]) == 0.0


def test_a_vibration_without_noise_counts(rest_m) -> None:
    """1 mm to and fro at 5 Hz for 1 s of ten, 4 mm a period: 20 mm."""
    t_s = 0.02 * np.arange(500)
    sway_m = 0.001 * np.sin(2 * np.pi * 5 * t_s) * ((t_s > 4.99) & (t_s < 5.99))
    true_m = rest_m + sway_m[:, None, None] * [1.0, 0, 0]
    assert score_pose(compared(true_m, true_m), rest_m).path_m == pytest.approx(0.020, abs=0.001)


def test_a_robot_that_stands_has_no_share_of_its_path(rest_m) -> None:
    """Of a path of rounding alone the share was 1e13."""
    true_m = rest_m + 1e-16 * np.random.default_rng(0).standard_normal((51, 1, 3))
    score = score_pose(compared(true_m + np.array([0, 0.05, 0]), true_m), rest_m)
    assert np.isnan(score.drift_share)
    assert score.centroid_rmse_m == pytest.approx(0.05)


def test_contacts_are_counted_by_pairs_of_frame_and_node(rest_m) -> None:
    """Of three told contacts two are true; of four true ones two are told. All frames are still."""
    told = np.zeros((5, 12))
    told[0, :3] = 0.9
    true = np.zeros((5, 12), dtype=bool)
    true[0, [0, 1, 5, 6]] = True
    standing = np.repeat(rest_m[None], 5, axis=0)
    contacts = score_pose(compared(standing, standing, (told, true)), rest_m).contacts
    assert contacts.precision == contacts.still_precision == pytest.approx(2 / 3)
    assert contacts.recall == contacts.still_recall == pytest.approx(0.5)
    assert np.isnan(contacts.moving_precision)


def test_without_a_frame_of_full_truth_there_is_no_score(rest_m) -> None:
    true_m = np.repeat(rest_m[None], 3, axis=0)
    true_m[:, 4] = np.nan
    assert score_pose(compared(np.nan_to_num(true_m), true_m), rest_m) is None
