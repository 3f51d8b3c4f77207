"""Errors, regimes and branches, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from four_nodes import TRUE_M, estimate_of, four_nodes, moved, truth_of
from tensegraph import Flag, InputError, Reconstruction, Settings, Status, Structure
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.models.evaluation.metrics import branch, evaluate, node_rmse_m, slack_frames
from tensegraph.models.evaluation.truth import Fault, TrueContacts, TrueLoads, Truth
from tensegraph.models.values.readings import Mode


class TestFourNodes:
    """Errors of (3, 0, 4), 0 and (0, 12, -5) mm: distances 5, 0, 13; one node, so a face's error is a third of it."""

    def test_nodes(self, result) -> None:
        nodes = result.absolute.nodes
        assert nodes.rmse_m == pytest.approx(np.sqrt((25 + 0 + 169) / 3) / 1e3, rel=1e-12)
        assert nodes.height_rmse_m == pytest.approx(np.sqrt((16 + 0 + 25) / 3) / 1e3, rel=1e-12)
        assert nodes.median_m == pytest.approx(0.005, rel=1e-12)
        assert nodes.percentile_95_m == pytest.approx(0.0122, rel=1e-12)  # 0.95 of the way: 5 + 0.9 (13 - 5)
        assert result.node_rmse_m == pytest.approx([nodes.rmse_m], rel=1e-12)
        assert result.worst_node == 3

    def test_faces(self, result) -> None:
        faces = result.absolute.faces
        assert faces.rmse_m == pytest.approx(np.sqrt((25 + 0 + 169) / 3 / 9) / 1e3, rel=1e-12)
        assert faces.height_rmse_m == pytest.approx(np.sqrt((16 + 0 + 25) / 3 / 9) / 1e3, rel=1e-12)
        assert faces.median_m == pytest.approx(0.005 / 3, rel=1e-12)

    def test_system(self, result) -> None:
        system = result.absolute.system
        assert system.rmse_m == pytest.approx(np.sqrt(194 * (1 + 1 / 9) / 6) / 1e3, rel=1e-12)
        assert system.height_rmse_m == pytest.approx(np.sqrt(41 * (1 + 1 / 9) / 6) / 1e3, rel=1e-12)

    def test_displacement(self, result) -> None:
        """The estimate's rest shape is 1 mm too high: z errors of 3, -1 and -6 mm are left."""
        nodes = result.displacement.nodes
        assert nodes.height_rmse_m == pytest.approx(np.sqrt((9 + 1 + 36) / 3) / 1e3, rel=1e-9)
        assert nodes.rmse_m == pytest.approx(np.sqrt((18 + 1 + 180) / 3) / 1e3, rel=1e-9)

    def test_consistency(self, result) -> None:
        """NEES 9/1 + 16/4 = 13, 0, 144/4 + 25/4 = 42.25; innovations of 1 mm at a sigma of 0.5 mm.

        Those of the two tendons at the free node never change, so that N is 2: 2.5 % of chi-square with 2 degrees are
        below 0.05064, 97.5 % below 7.3778.
        """
        c = result.consistency
        assert c.nees == pytest.approx([(13 + 0 + 42.25) / 3], rel=1e-12)
        assert (c.coverage_50, c.coverage_68, c.coverage_95) == (1 / 3, 1 / 3, 1 / 3)
        assert c.median_sigma_m == pytest.approx(0.003, rel=1e-12)
        assert c.nis == pytest.approx(4, rel=1e-9)
        assert c.nis_band == pytest.approx((0.05064 / 2, 7.3778 / 2), rel=1e-3)

    def test_frames(self, result) -> None:
        assert (result.frames, result.frames_without_truth) == (3, 0)
        assert result.compared.frame_error_m == pytest.approx([0.005, 0, 0.013])
        assert result.wrong_branch_frames == 0
        assert (result.faults, result.false_alarm_share) == ((), 0.0)


class TestFrames:
    def test_first_good_shape(self) -> None:
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[9, 0, 0], [5.1, 0, 0], [0, 4.9, 0], [9, 0, 0]]))
        assert evaluate(TRUE_M, estimate, truth_of(4)).first_good_s == pytest.approx(0.04)
        late = replace(estimate, node_position_m=moved([[9, 0, 0]] * 4))
        assert evaluate(TRUE_M, late, truth_of(4)).first_good_s is None

    def test_the_wrong_branch(self) -> None:
        """Mirrored about the anchors' plane all lengths are the same; a small error over the plane does not count."""
        structure = four_nodes()
        position = moved([[0, 0, 0], [0, 0, -200], [0, 0, 8]])
        assert evaluate(TRUE_M, estimate_of(structure, position), truth_of(3)).wrong_branch_frames == 1
        flat = np.repeat(TRUE_M[None], 1, axis=0)
        flat[0, 3, 2] = 0.001
        below = flat * np.array([1, 1, -1])
        truth = Truth(np.array([0.0, 1.0]), np.repeat(flat, 2, axis=0))
        assert branch(structure, flat) * branch(structure, below) == -1
        short = replace(structure, rod_length_m=np.array([0.0707]))
        assert evaluate(TRUE_M, estimate_of(short, below), truth).wrong_branch_frames == 0

    def test_the_branch_is_that_of_free_nodes_and_unknown_where_these_are(self) -> None:
        """Anchors are known, whether the truth tells them or not."""
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[0, 0, 0], [0, 0, -200]]))
        truth = truth_of(2)
        truth.node_position_m[:, :3] = np.nan
        assert evaluate(TRUE_M, estimate, truth).wrong_branch_frames == 1

    def test_nodes_in_another_order_are_refused(self) -> None:
        structure = four_nodes()
        truth = truth_of(2)
        truth.node_position_m[:, [0, 1]] = truth.node_position_m[:, [1, 0]]
        message = r"nodes 0 and 3: expected as far apart as their rod is long, 0\.12 m, got"
        with pytest.raises(InputError, match=message):
            evaluate(TRUE_M, estimate_of(structure, moved([[0, 0, 0]] * 2)), truth)

    def test_a_node_a_kilometre_away_for_a_moment_is_refused(self) -> None:
        structure = four_nodes()
        truth = truth_of(3)
        truth.node_position_m[1, 3, 0] = 1023.0
        truth.node_position_m[2, 2] = np.nan
        message = (
            rf"truth at {truth.t_s[1]:.3f} s: expected nodes as far apart as rods of 0\.12 m hold them, got 1023 m"
        )
        with pytest.raises(InputError, match=message):
            evaluate(TRUE_M, estimate_of(structure, moved([[0, 0, 0]] * 3)), truth)

    def test_no_branch_where_j_is_not_square(self) -> None:
        structure = four_nodes()
        more = replace_tendons(structure, [[0, 1], [1, 2], [1, 3]])
        position = moved([[0, 0, 0], [0, 0, -200]])
        assert evaluate(TRUE_M, estimate_of(more, position), truth_of(2)).wrong_branch_frames is None

    def test_frames_without_truth_are_left_out(self) -> None:
        """Truth from 0.02 to 0.06 s, with a node unseen at 0.04 s: of five frames, two are compared."""
        structure = four_nodes()
        truth = truth_of(5)
        truth.node_position_m[2, 3] = np.nan
        truth = replace(truth, t_s=truth.t_s[1:4], node_position_m=truth.node_position_m[1:4])
        estimate = estimate_of(structure, moved([[99, 0, 0], [3, 0, 0], [99, 0, 0], [3, 0, 0], [99, 0, 0]]))
        result = evaluate(TRUE_M, estimate, truth)
        assert (result.frames, result.frames_without_truth) == (2, 3)
        assert result.absolute.nodes.rmse_m == pytest.approx(0.003)
        assert result.displacement is None

    def test_nothing_in_common_is_refused(self) -> None:
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[0, 0, 0]] * 2), t_s=[10.0, 10.02])
        with pytest.raises(InputError, match=r"truth from 0\.000 to 0\.040 s covers no frame of the estimate, 10\.000"):
            evaluate(TRUE_M, estimate, truth_of(3))

    def test_positions_of_anchors_alone_are_no_truth(self) -> None:
        structure = four_nodes()
        truth = truth_of(3)
        truth.node_position_m[:, structure.free_nodes] = np.nan
        with pytest.raises(InputError, match="truth: expected positions of nodes that are no anchors, got none"):
            evaluate(TRUE_M, estimate_of(structure, moved([[0, 0, 0]] * 3)), truth)

    def test_an_estimate_without_covariance(self) -> None:
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[3, 0, 4]] * 3), variance_m2=(np.nan,) * 3)
        c = evaluate(TRUE_M, estimate, truth_of(3)).consistency
        assert np.isnan([c.coverage_95, c.median_sigma_m, *c.nees]).all()

    def test_ok_and_outside_of_the_ellipsoid_of_99_9_percent(self) -> None:
        """At a sigma of 1 mm along x, NEES of 16, 16.81, 16.81, 0 against 16.27; the third frame is in doubt."""
        estimate = estimate_of(four_nodes(), moved([[4, 0, 0], [4.1, 0, 0], [4.1, 0, 0], [0, 0, 0], [9, 0, 0]]))
        doubted = replace(estimate, status=(Status.OK, Status.OK, Status.DOUBT, Status.OK, Status.OK))
        assert evaluate(TRUE_M, doubted, truth_of(4)).consistency.ok_outside_999 == 1 / 4
        unknown = estimate_of(four_nodes(), moved([[9, 0, 0]] * 3), variance_m2=(np.nan,) * 3)
        assert np.isnan(evaluate(TRUE_M, unknown, truth_of(3)).consistency.ok_outside_999)

    def test_certainty_that_is_wrong_is_outside(self) -> None:
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[0, 0, 1]] * 3), variance_m2=(1e-6, 1e-6, 0.0))
        c = evaluate(TRUE_M, estimate, truth_of(3)).consistency
        assert c.coverage_95 == 0
        assert c.nees[0] == np.inf


def test_a_part_without_the_rest_has_no_displacements_and_no_faults_of_before() -> None:
    """The trial starts 1 s before the estimate, and rests for half a second."""
    estimate = estimate_of(four_nodes(), moved([[3, 0, 0]] * 5))
    faults = tuple(Fault("stuck", "tendon 3", np.array([3]), *span) for span in ((-0.9, -0.5), (-0.9, 0.04)))
    whole, part = (
        evaluate(TRUE_M, estimate, truth_of(5, rest_seconds=0.5, start_s=start_s, faults=faults))
        for start_s in (0.0, -1.0)
    )
    assert whole.displacement is not None
    assert part.displacement is None
    assert part.absolute == whole.absolute
    assert [fault.from_s for fault in part.faults] == [-0.9]


def test_contacts_are_known_between_their_times_alone() -> None:
    contacts = TrueContacts(np.array([1.0, 1.1, 1.2]), np.array([[True], [False], [True]]))
    np.testing.assert_array_equal(contacts.at(np.array([0.5, 1.0, 1.09, 1.29, 2.0]))[:, 0], [np.nan, 1, 0, 1, np.nan])


def replace_tendons(structure: Structure, tendons) -> Structure:
    return Structure(
        structure.rods, np.array(tendons), np.array(0.12), np.array(0.1), structure.anchors, TRUE_M[:3].copy()
    )


class TestRegimes:
    def test_by_hand(self) -> None:
        """Errors of 3, 6 and 9 mm along x (sigma 1 mm) in a quiet, a loaded and a loaded frame; the last one slack."""
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[3, 0, 0], [1, 0, 0], [0, 0, 2]]))
        estimate.mode[2, 3] = int(Mode.BENDING)
        true_n = np.zeros((3, 4, 3))
        true_n[1:, 3] = [0.5, -0.5, 0]  # across the rod
        truth = truth_of(3, loads=TrueLoads(np.arange(3) / 50, true_n))
        quiet, loaded, slack = evaluate(TRUE_M, estimate, truth).regimes
        assert [r.name for r in (quiet, loaded, slack)] == ["quiet", "loaded", "slack"]
        assert [r.frames for r in (quiet, loaded, slack)] == [1, 2, 1]
        assert (quiet.nees, loaded.nees, slack.nees) == pytest.approx((9, 1, 1))
        assert (quiet.coverage_95, loaded.coverage_95) == (0, 1)
        assert (quiet.node_rmse_m, slack.node_rmse_m) == pytest.approx((0.003, 0.002))
        assert loaded.node_rmse_m == pytest.approx(np.sqrt(2.5) / 1e3)

    def test_frames_without_known_loads_are_not_quiet(self) -> None:
        """Loads are known in the first frame alone; those of the node on the anchors never are."""
        true_n = np.full((3, 4, 3), np.nan)
        true_n[0, 3] = 0.0
        truth = truth_of(3, loads=TrueLoads(np.arange(3) / 50, true_n))
        regimes = evaluate(TRUE_M, estimate_of(four_nodes(), moved([[3, 0, 0]] * 3)), truth).regimes
        assert {regime.name: regime.frames for regime in regimes} == {"quiet": 1, "loaded": 0, "slack": 0}

    def test_without_known_loads_only_slack(self, result) -> None:
        (slack,) = result.regimes
        assert (slack.name, slack.frames) == ("slack", 0)
        assert np.isnan([slack.nees, slack.coverage_95]).all()

    def test_ambiguous_is_slack_and_a_tendon_between_anchors_or_without_reading_is_not(self) -> None:
        structure = four_nodes()
        flags = np.zeros((3, 4), dtype=np.int64)
        flags[:, :] = [[int(Flag.AMBIGUOUS), 0, 0, 0], [0, 0, int(Flag.AMBIGUOUS), 0], [0, 0, 0, int(Flag.AMBIGUOUS)]]
        estimate = estimate_of(structure, moved([[0, 0, 0]] * 3), flags=flags)
        estimate.length_m[2, 3] = np.nan
        assert slack_frames(estimate).tolist() == [False, True, False]


def test_node_rmse_by_hand(structure, rest, lengths_of) -> None:
    """Each of 9 free nodes 3 mm off in x and 4 mm in z: 5 mm."""
    frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(3)]
    result = Reconstruction.of(structure, FrameEstimator(structure, rest, Settings()).estimate(frames))
    truth = result.node_position_m + np.array([0.003, 0, 0.004])
    assert node_rmse_m(result, result.t_s, truth) == pytest.approx(0.005)
