"""Evaluation: numbers worked by hand, honesty measured on toys that are honest, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from tensegraph import Flag, InputError, Reconstruction, Structure, open_trial, six_strut, stream, three_strut
from tensegraph.commands.compare import NO_METHOD, Measured, comparison_rows
from tensegraph.io.comparison_tables import as_markdown, write_comparison_csv
from tensegraph.io.evaluation_tables import ScoredResult
from tensegraph.io.positions import read_positions
from tensegraph.io.result import read_estimate, write_tables
from tensegraph.models.evaluation.alignment import interpolated, rigid_alignment
from tensegraph.models.evaluation.consistency import coverage, independent_count, mean_band
from tensegraph.models.evaluation.estimate import Estimate
from tensegraph.models.evaluation.fault_score import false_alarm_share, score_fault
from tensegraph.models.evaluation.load_score import score_loads
from tensegraph.models.evaluation.metrics import branch, evaluate, slack_frames
from tensegraph.models.evaluation.truth import Fault, TrueLoads, Truth
from tensegraph.models.structure.external_loads import ExternalLoads, observable_part
from tensegraph.models.values.readings import Mode

TRUE_M = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0.05, 0.05, 0.1]])


def four_nodes() -> Structure:
    """Three anchors, one free node on a rod and two tendons (a square J); one face, 1-2-3."""
    tendons = np.array([[0, 1], [1, 2], [1, 3], [2, 3]])
    return Structure(np.array([[0, 3]]), tendons, np.array(0.12), np.array(0.1), np.array([0, 1, 2]), TRUE_M[:3].copy())


def estimate_of(structure, position_m, variance_m2=(1e-6, 4e-6, 4e-6), t_s=None, flags=None) -> Estimate:
    """An estimate with measured lengths 1 mm too long, with a sigma of 1 mm."""
    count, tendons = len(position_m), len(structure.tendons)
    sigma_m = np.full((count, tendons), 0.001)
    covariance = np.broadcast_to(np.diag(variance_m2), (count, structure.node_count, 3, 3))
    return Estimate(
        t_s=np.arange(count) / 50 if t_s is None else np.asarray(t_s),
        node_position_m=position_m,
        node_covariance_m2=covariance,
        length_m=structure.tendon_length_m(position_m) + 0.001,
        sigma_m=sigma_m,
        mode=np.full((count, tendons), int(Mode.STRETCHING)),
        flags=np.zeros((count, tendons), dtype=np.int64) if flags is None else flags,
        innovation_sigma_m=0.5 * sigma_m,
    )


def moved(error_mm) -> np.ndarray:
    """(frames, nodes, 3): the free node off by so much in each frame."""
    position = np.repeat(TRUE_M[None], len(error_mm), axis=0)
    position[:, 3] += 1e-3 * np.asarray(error_mm)
    return position


def truth_of(count, **more) -> Truth:
    return Truth(np.arange(count) / 50, np.repeat(TRUE_M[None], count, axis=0), **more)


@pytest.fixture(scope="module")
def result():
    structure = four_nodes()
    estimate = estimate_of(structure, moved([[3, 0, 4], [0, 0, 0], [0, 12, -5]]))
    rest = TRUE_M + np.array([[0, 0, 0]] * 3 + [[0, 0, 0.001]])
    return evaluate(structure, rest, estimate, truth_of(3, rest_seconds=0.03))


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
        """NEES 9/1 + 16/4 = 13, 0, 144/4 + 25/4 = 42.25; innovations of 1 mm at a sigma of 0.5 mm."""
        c = result.consistency
        assert c.nees == pytest.approx([(13 + 0 + 42.25) / 3], rel=1e-12)
        assert (c.coverage_50, c.coverage_68, c.coverage_95) == (1 / 3, 1 / 3, 1 / 3)
        assert c.median_sigma_m == pytest.approx(0.003, rel=1e-12)
        assert c.nis == pytest.approx(4, rel=1e-9)

    def test_frames(self, result) -> None:
        assert (result.frames, result.frames_without_truth) == (3, 0)
        assert result.compared.frame_error_m == pytest.approx([0.005, 0, 0.013])
        assert result.wrong_branch_frames == 0
        assert (result.faults, result.false_alarm_share) == ((), 0.0)


class TestFrames:
    def test_first_good_shape(self) -> None:
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[9, 0, 0], [5.1, 0, 0], [0, 4.9, 0], [9, 0, 0]]))
        assert evaluate(structure, TRUE_M, estimate, truth_of(4)).first_good_s == pytest.approx(0.04)
        late = replace(estimate, node_position_m=moved([[9, 0, 0]] * 4))
        assert evaluate(structure, TRUE_M, late, truth_of(4)).first_good_s is None

    def test_the_wrong_branch(self) -> None:
        """Mirrored about the anchors' plane all lengths are the same; a small error over the plane does not count."""
        structure = four_nodes()
        position = moved([[0, 0, 0], [0, 0, -200], [0, 0, 8]])
        assert evaluate(structure, TRUE_M, estimate_of(structure, position), truth_of(3)).wrong_branch_frames == 1
        flat = np.repeat(TRUE_M[None], 1, axis=0)
        flat[0, 3, 2] = 0.001
        below = flat * np.array([1, 1, -1])
        truth = Truth(np.array([0.0, 1.0]), np.repeat(flat, 2, axis=0))
        assert branch(structure, flat) * branch(structure, below) == -1
        assert evaluate(structure, TRUE_M, estimate_of(structure, below), truth).wrong_branch_frames == 0

    def test_no_branch_where_j_is_not_square(self) -> None:
        structure = four_nodes()
        more = replace_tendons(structure, [[0, 1], [1, 2], [1, 3]])
        position = moved([[0, 0, 0], [0, 0, -200]])
        assert evaluate(more, TRUE_M, estimate_of(more, position), truth_of(2)).wrong_branch_frames is None

    def test_frames_without_truth_are_left_out(self) -> None:
        """Truth from 0.02 to 0.06 s, with a node unseen at 0.04 s: of five frames, two are compared."""
        structure = four_nodes()
        truth = truth_of(5)
        truth.node_position_m[2, 3] = np.nan
        truth = replace(truth, t_s=truth.t_s[1:4], node_position_m=truth.node_position_m[1:4])
        estimate = estimate_of(structure, moved([[99, 0, 0], [3, 0, 0], [99, 0, 0], [3, 0, 0], [99, 0, 0]]))
        result = evaluate(structure, TRUE_M, estimate, truth)
        assert (result.frames, result.frames_without_truth) == (2, 3)
        assert result.absolute.nodes.rmse_m == pytest.approx(0.003)
        assert result.displacement is None

    def test_nothing_in_common_is_refused(self) -> None:
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[0, 0, 0]] * 2), t_s=[10.0, 10.02])
        with pytest.raises(InputError, match=r"truth from 0\.000 to 0\.040 s covers no frame of the estimate, 10\.000"):
            evaluate(structure, TRUE_M, estimate, truth_of(3))

    def test_an_estimate_without_covariance(self) -> None:
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[3, 0, 4]] * 3), variance_m2=(np.nan,) * 3)
        c = evaluate(structure, TRUE_M, estimate, truth_of(3)).consistency
        assert np.isnan([c.coverage_95, c.median_sigma_m, *c.nees]).all()

    def test_certainty_that_is_wrong_is_outside(self) -> None:
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[0, 0, 1]] * 3), variance_m2=(1e-6, 1e-6, 0.0))
        c = evaluate(structure, TRUE_M, estimate, truth_of(3)).consistency
        assert c.coverage_95 == 0
        assert c.nees[0] == np.inf


def replace_tendons(structure: Structure, tendons) -> Structure:
    return Structure(
        structure.rods, np.array(tendons), np.array(0.12), np.array(0.1), structure.anchors, TRUE_M[:3].copy()
    )


class TestConsistency:
    def toy(self, structure, count=600, correlation=0.0, scale=1.0, seed=0):
        """Errors drawn from the covariance, each `correlation` times the one before and a fresh part."""
        rng = np.random.default_rng(seed)
        root = 1e-3 * np.array([[1.0, 0, 0], [0.5, 2.0, 0], [-0.3, 0.2, 0.7]])
        fresh, error = rng.standard_normal((count, 3)), np.empty((count, 3))
        error[0] = fresh[0]
        for k in range(1, count):
            error[k] = correlation * error[k - 1] + np.sqrt(1 - correlation**2) * fresh[k]
        position = np.repeat(TRUE_M[None], count, axis=0)
        position[:, 3] += error @ root.T
        estimate = estimate_of(structure, position)
        covariance = np.broadcast_to(scale * root @ root.T, (count, 4, 3, 3))
        return evaluate(
            structure, TRUE_M, replace(estimate, node_covariance_m2=covariance), truth_of(count)
        ).consistency

    @pytest.mark.parametrize("correlation", [0.0, 0.95])
    def test_nees_of_a_linear_gaussian_toy_is_in_its_band(self, correlation) -> None:
        structure = four_nodes()
        inside = [
            band[0] <= nees <= band[1]
            for c in (self.toy(structure, correlation=correlation, seed=seed) for seed in range(40))
            for nees, band in zip(c.nees, c.nees_band, strict=True)
        ]
        assert np.mean(inside) > 0.8  # 0.95 of 40, less four of its sigmas

    def test_overconfidence_is_out_of_its_band(self) -> None:
        c = self.toy(four_nodes(), scale=0.5)
        assert c.nees[0] > c.nees_band[0, 1]
        assert c.coverage_95 < 0.85

    def test_coverage_of_an_honest_toy(self) -> None:
        c = self.toy(four_nodes(), count=4000)
        assert (c.coverage_50, c.coverage_68, c.coverage_95) == pytest.approx((0.5, 0.68, 0.95), abs=0.03)

    def test_band_of_one_hundred_by_table(self) -> None:
        """Chi-square with 300 degrees: 2.5 % below 253.91, 97.5 % below 349.87."""
        assert mean_band(3, 100) == pytest.approx((2.5391, 3.4987), abs=1e-4)

    def test_independent_count(self) -> None:
        """White noise counts in full; squares of AR(1) have rho^2k, which sums to n (1 - rho^2) / (1 + rho^2)."""
        rng = np.random.default_rng(1)
        assert independent_count(rng.standard_normal(4000)) == pytest.approx(4000, rel=0.25)
        x = np.zeros(40_000)
        for k in range(1, len(x)):
            x[k] = 0.9 * x[k - 1] + rng.standard_normal()
        assert independent_count(x**2) == pytest.approx(len(x) * (1 - 0.81) / (1 + 0.81), rel=0.3)
        assert independent_count(np.ones(5)) == 1
        assert independent_count(np.array([])) == 0

    @given(st.lists(st.floats(0, 50), min_size=1), st.floats(0.01, 0.98), st.floats(0.01, 0.98))
    def test_a_larger_ellipsoid_holds_no_less(self, nees, one, other) -> None:
        low, high = sorted((one, other))
        assert 0 <= coverage(np.array(nees), low) <= coverage(np.array(nees), high) <= 1


class TestFaults:
    FAULT = Fault("stuck", "tendon 2", np.array([2]), 0.05, 0.13)

    def estimate(self, flags) -> Estimate:
        return estimate_of(four_nodes(), np.repeat(TRUE_M[None], 10, axis=0), flags=np.asarray(flags))

    def flags(self, *cells) -> np.ndarray:
        table = np.zeros((10, 4), dtype=np.int64)
        for frame, tendon, flag in cells:
            table[frame, tendon] = flag
        return table

    def test_delay(self) -> None:
        """Frames every 0.02 s: the first in the interval is 3, at 0.06 s."""
        estimate = self.estimate(self.flags((1, 2, Flag.STUCK), (5, 2, Flag.STUCK), (6, 2, Flag.STUCK)))
        score = score_fault(self.FAULT, estimate)
        assert (score.tendons, score.named) == (1, 1)
        assert score.delay_s == pytest.approx(0.05)

    def test_not_seen(self) -> None:
        estimate = self.estimate(self.flags((1, 2, Flag.STUCK), (5, 1, Flag.STUCK), (5, 2, Flag.TOO_FAST)))
        score = score_fault(self.FAULT, estimate)
        assert (score.named, score.delay_s) == (0, None)

    def test_a_length_left_out_names_its_sensor(self) -> None:
        estimate = self.estimate(self.flags())
        estimate.sigma_m[4, 2] = np.inf
        assert score_fault(self.FAULT, estimate).delay_s == pytest.approx(0.03)

    def test_a_board_is_seen_when_its_last_tendon_is(self) -> None:
        fault = replace(self.FAULT, where="board 0", tendons=np.array([0, 2]))
        one = self.flags((3, 0, Flag.MISSING))
        both = one | self.flags((6, 2, Flag.MISSING))
        assert score_fault(fault, self.estimate(one)).delay_s is None
        assert score_fault(fault, self.estimate(one)).named == 1
        assert score_fault(fault, self.estimate(both)).delay_s == pytest.approx(0.07)

    def test_false_alarms(self) -> None:
        """Of 10 x 4 readings 4 are in the fault; of the 36 others 2 are named, one only warms up."""
        flags = self.flags((4, 2, Flag.STUCK), (4, 1, Flag.OUTLIER), (8, 2, Flag.STUCK), (0, 0, Flag.WARMING_UP))
        assert false_alarm_share([self.FAULT], self.estimate(flags)) == pytest.approx(2 / 36)

    @pytest.mark.parametrize(
        ("line", "message"),
        [
            ("tendon = 24", r"truth\.fault\[0\]\.tendon: expected a tendon from 0 to 23, got 24"),
            ("board = 2", r"truth\.fault\[0\]\.board: expected one of the trial's 2 boards, got 2"),
            ("", r"truth\.fault\[0\]: expected either tendon or board"),
            ("tendon = 1\nboard = 1", r"truth\.fault\[0\]: expected either tendon or board"),
        ],
    )
    def test_faults_that_can_not_be(self, trial_copy, line, message) -> None:
        table = f'\n[[truth.fault]]\nkind = "stuck"\nfrom_s = 1.0\nuntil_s = 2.0\n{line}\n'
        trial = open_trial(trial_copy(trial=lambda text: text + table))
        with pytest.raises(InputError, match=message):
            trial.faults()

    def test_a_board_s_fault_spoils_its_tendons(self, trial_copy) -> None:
        table = '\n[[truth.fault]]\nkind = "unplugged"\nfrom_s = 1.0\nuntil_s = 2.0\nboard = 1\n'
        (fault,) = open_trial(trial_copy(trial=lambda text: text + table)).faults()
        assert fault.where == "board 1"
        np.testing.assert_array_equal(fault.tendons, np.arange(12, 24))


class TestTruth:
    TIMES = np.array([0.0, 1.0, 2.0, 7.0, 8.0])

    def at(self, *t_s, values=(0.0, 4.0, 8.0, 0.0, 2.0)) -> np.ndarray:
        positions = np.repeat(np.array(values)[:, None, None], 3, axis=2)
        return interpolated(np.array(t_s), self.TIMES, positions)[:, 0, 0]

    def test_on_straight_lines(self) -> None:
        np.testing.assert_allclose(self.at(0.0, 0.25, 1.0, 1.5, 8.0), [0, 1, 4, 6, 2])

    def test_never_outside_nor_in_holes(self) -> None:
        np.testing.assert_array_equal(
            self.at(-0.01, 2.0, 2.01, 6.99, 7.0, 8.01), [np.nan, 8, np.nan, np.nan, 0, np.nan]
        )

    def test_not_next_to_an_unseen_node(self) -> None:
        values = (0.0, np.nan, 8.0, 0.0, 2.0)
        np.testing.assert_array_equal(self.at(0.0, 0.5, 1.5, 2.0, values=values), [0, np.nan, np.nan, 8])

    def test_files_of_other_systems(self, tmp_path) -> None:
        """Only some nodes, in any order, with blank cells where a marker was hidden."""
        path = tmp_path / "mocap.csv"
        path.write_text("n1_z_m,t_s,n1_x_m,n1_y_m\n3,0.0,1,2\n,0.1,,\n")
        positions = read_positions(path, 3)
        np.testing.assert_array_equal(positions.t_s, [0.0, 0.1])
        np.testing.assert_array_equal(positions.node_position_m[:, 1], [[1, 2, 3], [np.nan] * 3])
        assert np.isnan(positions.node_position_m[:, [0, 2]]).all()

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("t_s,x\n0,1\n1,1\n", "holds no node: expected columns as n0_x_m"),
            ("n0_x_m\n0\n1\n", "column 't_s' is missing"),
            ("t_s,n0_x_m\n0,1\n", "expected at least two rows, got 1"),
            ("t_s,n0_x_m\n0,1\n1,1\n1,2\n", "row 4, column t_s: expected more than 1.0, got 1.0"),
            ("t_s,n0_x_m\n0,1\n1,left\n", "row 3, column n0_x_m: expected a finite number, got 'left'"),
        ],
    )
    def test_files_that_are_none(self, tmp_path, text, message) -> None:
        path = tmp_path / "mocap.csv"
        path.write_text(text)
        with pytest.raises(InputError) as error:
            read_positions(path, 3)
        assert message in str(error.value)


class TestAlignment:
    @given(st.integers(0, 10_000))
    def test_a_rigid_motion_is_undone(self, seed) -> None:
        rng = np.random.default_rng(seed)
        points, rotation = rng.standard_normal((20, 3)), Rotation.random(rng=rng)
        found, shift = rigid_alignment(points, rotation.apply(points) + np.array([1, -2, 3]))
        assert (found * rotation.inv()).magnitude() < 1e-7
        np.testing.assert_allclose(shift, [1, -2, 3], atol=1e-9)

    def test_agrees_with_umeyama_s_formula(self) -> None:
        """With noise, R = U diag(1, 1, det U V^T) V^T of the cross-covariance U D V^T."""
        rng = np.random.default_rng(4)
        points = rng.standard_normal((30, 3))
        onto = Rotation.random(rng=rng).apply(points) + 0.2 * rng.standard_normal((30, 3))
        u, _, vt = np.linalg.svd((onto - onto.mean(0)).T @ (points - points.mean(0)))
        expected = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        found, shift = rigid_alignment(points, onto)
        np.testing.assert_allclose(found.as_matrix(), expected, atol=1e-12)
        np.testing.assert_allclose(shift, onto.mean(0) - expected @ points.mean(0), atol=1e-12)

    def test_truth_in_another_frame(self, structure, rest) -> None:
        """Turned by 90 degrees and shifted it is far off as it stands, and exact once aligned; sizes are kept."""
        rng = np.random.default_rng(5)
        position = rest.node_position_m + 0.01 * rng.standard_normal((6, 12, 3))
        turned = position @ Rotation.from_euler("z", 90, degrees=True).as_matrix().T + [1.0, 0, 0]
        truth = Truth(np.arange(6) / 50, turned, rest_seconds=0.02)
        estimate = estimate_of(structure, position)
        plain = evaluate(structure, rest.node_position_m, estimate, truth)
        aligned = evaluate(structure, rest.node_position_m, estimate, truth, align=True)
        assert plain.absolute.nodes.rmse_m > 0.5
        assert plain.rotation_deg is None
        assert aligned.absolute.nodes.rmse_m < 1e-12
        assert aligned.rotation_deg == pytest.approx(90)
        larger = evaluate(
            structure, rest.node_position_m, estimate, replace(truth, node_position_m=1.1 * turned), align=True
        )
        assert larger.absolute.nodes.rmse_m > 0.005


def test_faces() -> None:
    """The paper's structure has eight closed triangles, one of them the base; the prism has its top."""
    assert six_strut(0.3).faces.tolist() == [
        [0, 7, 9], [1, 3, 10], [2, 4, 6], [3, 7, 11], [4, 8, 9], [5, 6, 10], [5, 8, 11]
    ]  # fmt: skip
    assert three_strut(0.3, 0.15).faces.tolist() == [[3, 4, 5]]
    assert four_nodes().faces.tolist() == [[1, 2, 3]]


@pytest.fixture(scope="module")
def first_second(example):
    trial = open_trial(example)
    readings = (row for row in trial.readings() if row.host_s < 1.0)
    return Reconstruction.of(trial.description.structure, stream(readings, trial.description))


class TestResultsAreReadBack:
    @pytest.fixture
    def saved(self, first_second, tmp_path):
        write_tables(first_second, 0.95, tmp_path)
        return first_second, tmp_path

    def test_as_they_were_written(self, saved) -> None:
        result, path = saved
        read, kept = read_estimate(path, result.structure), Estimate.of(result)
        np.testing.assert_allclose(read.t_s, kept.t_s, atol=1e-4)
        np.testing.assert_allclose(read.node_position_m, kept.node_position_m, atol=1e-6)
        np.testing.assert_allclose(read.node_covariance_m2, kept.node_covariance_m2, rtol=1e-8, atol=1e-16)
        np.testing.assert_array_equal(read.flags, kept.flags)
        for name in ("length_m", "sigma_m", "innovation_sigma_m"):
            np.testing.assert_allclose(getattr(read, name), getattr(kept, name), atol=1e-6)

    @pytest.mark.parametrize(
        ("file", "old", "new", "message"),
        [
            (
                "lengths.csv",
                "stretching,,",
                "stretching,asleep,",
                "column flags: expected names of flags joined by |, got",
            ),
            ("lengths.csv", ",stretching,", ",x,stretching,", "row 2: expected 8 fields, got 9"),
            ("ellipsoids.csv", "0.0000,3,", "0.0000,4,", "expected 12 rows (node 0 to 11) for each row of shape.csv"),
            ("lengths.csv", ",stretching,", ",flying,", "column mode: expected stretching or bending, got 'flying'"),
            ("estimated_loads.csv", "0.0000,3,", "0.0000,2,", "expected 9 rows (node 3 to 11) for each row of"),
            ("shape.csv", "n11_z_m", "n12_z_m", "shape.csv: expected the positions of all 12 nodes"),
        ],
    )
    def test_or_refused(self, saved, file, old, new, message) -> None:
        result, path = saved
        text = (path / file).read_text()
        assert old in text
        (path / file).write_text(text.replace(old, new, 1))
        with pytest.raises(InputError) as error:
            read_estimate(path, result.structure)
        assert message in str(error.value)

    def test_with_loads(self, saved) -> None:
        result, path = saved
        read = read_estimate(path, result.structure).loads
        free = result.structure.free_nodes
        np.testing.assert_allclose(read.force_n[:, free], result.loads.force_n[:, free], atol=1e-4)
        np.testing.assert_allclose(read.sigma_n[:, free], result.loads.sigma_n[:, free], atol=1e-4)
        assert np.isnan(read.force_n[:, result.structure.anchors]).all()
        (path / "estimated_loads.csv").unlink()  # as a result without [mechanics]
        assert read_estimate(path, result.structure).loads is None

    def test_flags_by_name(self) -> None:
        for flags in (Flag(0), Flag.STUCK, Flag.MISSING | Flag.OUTLIER | Flag.AMBIGUOUS):
            assert Flag.of_names(flags.names()) == flags


class TestComparison:
    def measured(self) -> list[Measured]:
        structure = four_nodes()
        made = []
        for trial, errors, seconds in (("one", [[3, 0, 0]] * 2, 0.2), ("two", [[0, 0, 6]] * 6, 0.6)):
            estimate = estimate_of(structure, moved(errors))
            evaluation = evaluate(structure, TRUE_M, estimate, truth_of(len(errors)))
            made.append(Measured(trial, "any", len(errors), seconds, evaluation, ""))
        return [*made, Measured("three", "any", 4, np.nan, None, "gave up")]

    def test_all_frames_of_all_trials_count_alike(self) -> None:
        """Two frames of 3 mm and six of 6 mm: (2 * 9 + 6 * 36) / 8; 2 and 6 frames in 0.2 and 0.6 s."""
        rows = comparison_rows(self.measured()[:2])
        together = rows[0]
        assert (together.trial, together.trials, together.frames) == ("all", 2, 8)
        assert together.errors.nodes.rmse_m == pytest.approx(np.sqrt(234 / 8) / 1e3)
        assert together.ms_per_frame == pytest.approx(100)
        assert together.coverage_95 == pytest.approx(0)  # NEES 9 and 36 / 4 against 7.81
        assert chi2.ppf(0.95, 3) == pytest.approx(7.81, abs=0.01)
        assert [row.trial for row in rows[1:]] == ["one", "two"]

    def test_a_method_that_gave_up_shows(self, tmp_path) -> None:
        rows = comparison_rows(self.measured())
        assert rows[0].trials == 2
        text = as_markdown(rows, "tensegraph compare one two three")
        assert "| three | - |" in text
        assert "| *Mao et al.* | 21.2 | 35.8 | 39.4 |" in text
        write_comparison_csv(rows, tmp_path / "c.csv")
        lines = (tmp_path / "c.csv").read_text().splitlines()
        assert len({line.count(",") for line in lines}) == 1
        assert lines[1].startswith("published,,Caluwaerts et al.,,,0.0456,")
        assert lines[-1].startswith("measured,three,any,0,4,,")


class TestLoads:
    """Node 3 of `four_nodes` is on a rod that stands on anchor 0, along (1, 1, 2) / sqrt(6)."""

    def test_the_observable_part_by_hand(self) -> None:
        """Of (6, 0, 0), w w^T F = 6 / 6 (1, 1, 2): (5, -1, -2) is left; anchors show nothing."""
        force = np.tile([6.0, 0, 0], (4, 1))
        part = observable_part(four_nodes(), force, TRUE_M)
        np.testing.assert_allclose(part[3], [5, -1, -2], atol=1e-12)
        assert np.isnan(part[:3]).all()
        np.testing.assert_array_equal(force[3], [6, 0, 0])

    def test_all_of_it_on_a_floating_rod(self, structure, rest) -> None:
        """Of the six-strut, rods 4-5, 7-8 and 10-11 float."""
        force = np.random.default_rng(0).standard_normal((12, 3))
        part = observable_part(structure, force, rest.node_position_m)
        np.testing.assert_array_equal(part[[4, 5, 7, 8, 10, 11]], force[[4, 5, 7, 8, 10, 11]])
        for anchor, node in ((0, 3), (1, 6), (2, 9)):
            along = rest.node_position_m[node] - rest.node_position_m[anchor]
            assert part[node] @ along == pytest.approx(0, abs=1e-12)

    def scored(self, result):
        """Two nodes in four frames, along x, in newtons.

        True 1 0 | 0.25 0 | 0 0.1 | 0.5 0.4; estimated 0.7 0 | 0.1 0.3 | 0 0.3 | 0.2 0.6. Truly loaded are (1, 0.25,
        0.5, 0.4), of which 0.7 and 0.6 are called so (0.2 is not above 0.2); so are 0.3 and 0.3 of the four unloaded.
        """
        true, estimated = np.zeros((4, 2, 3)), np.zeros((4, 2, 3))
        true[..., 0] = [[1, 0], [0.25, 0], [0, 0.1], [0.5, 0.4]]
        estimated[..., 0] = [[0.7, 0], [0.1, 0.3], [0, 0.3], [0.2, 0.6]]
        return score_loads(replace(result.compared, true_load_n=true, estimated_load_n=estimated), 0.2)

    def test_a_score_by_hand(self, result) -> None:
        score = self.scored(result)
        assert score.loaded_rmse_n == pytest.approx(np.sqrt((0.3**2 + 0.15**2 + 0.3**2 + 0.2**2) / 4))
        assert score.unloaded_rmse_n == pytest.approx(np.sqrt((0 + 0.3**2 + 0 + 0.2**2) / 4))
        assert (score.recall, score.precision, score.false_alarm_share) == (2 / 4, 2 / 4, 2 / 4)
        assert score.quiet_false_alarm_share == 1 / 2  # the third frame: 0 and 0.3
        assert (score.clear_frames, score.most_loaded_share) == (2, 1 / 2)  # 1 N at the first: right; 0.5 N: not

    def test_without_loads_on_either_side_there_is_none(self, result) -> None:
        assert result.loads is None
        assert score_loads(replace(result.compared, true_load_n=np.zeros((3, 1, 3))), 0.2) is None

    def test_nothing_loaded_nothing_found(self, result) -> None:
        nothing = np.zeros((3, 1, 3))
        score = score_loads(replace(result.compared, true_load_n=nothing, estimated_load_n=nothing), 0.2)
        assert np.isnan([score.loaded_rmse_n, score.recall, score.precision, score.most_loaded_share]).all()
        assert (score.unloaded_rmse_n, score.false_alarm_share, score.clear_frames) == (0, 0, 0)

    def test_evaluate_compares_them_along_the_true_rod_at_the_frames(self) -> None:
        """True 0 at 0 s and (6, 0, 0) at 0.04 s: at 0.02 s (3, 0, 0), of which (2.5, -0.5, -1) is observable."""
        structure = four_nodes()
        force = np.full((3, 4, 3), np.nan)
        force[:, 3] = [2.5, -0.5, 0]
        loads = ExternalLoads(force, np.full((3, 4), 0.1))
        true_n = np.zeros((2, 4, 3))
        true_n[1, 3] = [6, 0, 0]
        estimate = replace(estimate_of(structure, moved([[0, 0, 0]] * 3)), loads=loads)
        truth = truth_of(3, loads=TrueLoads(np.array([0.0, 0.04]), true_n))
        compared = evaluate(structure, TRUE_M, estimate, truth).compared
        np.testing.assert_allclose(compared.true_load_n[:, 0], [[0, 0, 0], [2.5, -0.5, -1], [5, -1, -2]], atol=1e-12)
        np.testing.assert_allclose(compared.estimated_load_n[1, 0] - compared.true_load_n[1, 0], [0, 0, 1], atol=1e-12)


class TestRegimes:
    def test_by_hand(self) -> None:
        """Errors of 3, 6 and 9 mm along x (sigma 1 mm) in a quiet, a loaded and a loaded frame; the last one slack."""
        structure = four_nodes()
        estimate = estimate_of(structure, moved([[3, 0, 0], [1, 0, 0], [0, 0, 2]]))
        estimate.mode[2, 3] = int(Mode.BENDING)
        true_n = np.zeros((3, 4, 3))
        true_n[1:, 3] = [0.5, -0.5, 0]  # across the rod
        truth = truth_of(3, loads=TrueLoads(np.arange(3) / 50, true_n))
        quiet, loaded, slack = evaluate(structure, TRUE_M, estimate, truth).regimes
        assert [r.name for r in (quiet, loaded, slack)] == ["quiet", "loaded", "slack"]
        assert [r.frames for r in (quiet, loaded, slack)] == [1, 2, 1]
        assert (quiet.nees, loaded.nees, slack.nees) == pytest.approx((9, 1, 1))
        assert (quiet.coverage_95, loaded.coverage_95) == (0, 1)
        assert (quiet.node_rmse_m, slack.node_rmse_m) == pytest.approx((0.003, 0.002))
        assert loaded.node_rmse_m == pytest.approx(np.sqrt(2.5) / 1e3)

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
        assert slack_frames(structure, estimate).tolist() == [False, True, False]


def test_a_score_is_json_without_holes() -> None:
    """What is not known is null, what would be infinite too; frames stay out."""
    import json
    from pathlib import Path

    structure = four_nodes()
    estimate = estimate_of(structure, moved([[0, 0, 1]] * 3), variance_m2=(1e-6, 1e-6, 0.0))
    score = ScoredResult(Path("out"), "toy", NO_METHOD, evaluate(structure, TRUE_M, estimate, truth_of(3)))
    read = json.loads(json.dumps(score.as_json(), allow_nan=False))
    assert read["consistency"]["nees"] == [None]
    assert read["absolute"]["nodes"]["rmse_m"] == pytest.approx(0.001)
    assert read["free_nodes"] == [3]
    assert "compared" not in read
