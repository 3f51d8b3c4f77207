"""The shape at rest, and what taring finds of stiffness."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from balance import K, nominal
from roll import ROLL
from tensegraph import Structure, open_trial
from tensegraph.estimator.rest.rest_step import rest_step
from tensegraph.models.balance.statics import Statics
from tensegraph.models.structure.floor import UP, Floor
from tensegraph.models.structure.lengths import length_jacobian, member_length_m
from tensegraph.models.structure.mechanics import Mechanics
from tensegraph.models.structure.rest_shape import GeometrySigma, RestSettings
from tensegraph.models.values.readings import RestLengths
from tensegraph.models.values.rotations import rotation

TILTED = np.array([0.026, 0.0, np.sqrt(1 - 0.026**2)])


def test_measured_rest_shape_keeps_rods_and_anchors(structure: Structure, rest) -> None:
    """Exact rods and anchors: the measured nodes move onto them, and their uncertainty shrinks alike."""
    exact = GeometrySigma(rod_length_m=1e-6, anchor_m=1e-6)
    noise = 0.0003 * np.random.default_rng(2).standard_normal((12, 3))
    found = rest_step(structure, None, rest.node_position_m + noise, exact, RestSettings())
    assert found.source == "measured"
    np.testing.assert_allclose(member_length_m(found.node_position_m, structure.rods), 0.3, atol=2e-6)
    np.testing.assert_allclose(found.node_position_m[:3], structure.anchor_position_m, atol=1e-5)
    np.testing.assert_array_equal(found.structure.anchor_position_m, found.node_position_m[:3])
    assert found.wrong == ()
    along_rod = length_jacobian(found.node_position_m, structure.rods).reshape(6, -1)
    assert np.abs(np.diag(along_rod @ found.covariance_m2 @ along_rod.T)).max() < 1.1e-10
    error = np.linalg.norm(found.node_position_m - rest.node_position_m)
    assert error < np.linalg.norm(noise)


def test_found_rest_shape_says_so(structure: Structure) -> None:
    found = rest_step(structure, None, None, GeometrySigma(), RestSettings())
    assert found.source == "found"
    lengths = found.lengths(2.0)
    assert lengths.sigma_m[5] > 0.001


class TestRestStep:
    def test_nothing_measured_gives_a_shape_in_balance(self, structure, balanced) -> None:
        assert balanced.source == "found"
        assert balanced.unbalanced_n[1] < 0.001
        assert np.sqrt(np.trace(balanced.covariance_m2) / 9) == pytest.approx(0.0033, rel=0.3)

    def test_tare_finds_the_ratios_of_stiffness(self, structure) -> None:
        """Stiffness drawn 10 % apart, shape measured exactly: ratios come back, the scale stays with the prior."""
        rng = np.random.default_rng(4)
        true = replace(nominal(structure), stiffness_n_per_m=K * np.exp(0.1 * rng.standard_normal(24)))
        exact = RestSettings(measured_sigma_m=1e-6, stiffness_spread=1e-6, natural_length_sigma_m=1e-7)
        at_rest = rest_step(structure, true, None, GeometrySigma(), exact).node_position_m
        found = rest_step(structure, nominal(structure), at_rest, GeometrySigma(), RestSettings(measured_sigma_m=1e-5))
        free = structure.free_tendons
        error = np.log(found.mechanics.stiffness_n_per_m / true.stiffness_n_per_m)[free]
        assert np.std(error) < 0.02
        assert found.unbalanced_n[0] > 0.2
        assert found.unbalanced_n[1] < 0.005

    def test_covariance_is_honest(self, structure) -> None:
        """Noise and spread drawn as assumed: the squared error over its covariance is one per coordinate."""
        rng, nees = np.random.default_rng(5), []
        exact = RestSettings(stiffness_spread=1e-6, natural_length_sigma_m=1e-7)
        for _ in range(12):
            stiffness = K * np.exp(0.1 * rng.standard_normal(24))
            length_m = structure.natural_length_m + 0.0003 * rng.standard_normal(24)
            true = Mechanics(stiffness, length_m, 0.03, 0.02)
            at_rest = rest_step(structure, true, None, GeometrySigma(), exact).node_position_m
            measured = at_rest + 0.0003 * rng.standard_normal((12, 3))
            found = rest_step(structure, nominal(structure), measured, GeometrySigma(), RestSettings())
            error = (found.node_position_m - at_rest)[3:].ravel()
            nees.append(error @ np.linalg.pinv(found.covariance_m2[9:, 9:], 1e-9) @ error / 21)
        assert 0.6 < np.mean(nees) < 1.5


@pytest.fixture(scope="module")
def true(structure):
    """A structure whose tendons differ, and its shape in balance."""
    rng = np.random.default_rng(4)
    stiffness = K * np.exp(0.1 * rng.standard_normal(24))
    mechanics = Mechanics(stiffness, structure.natural_length_m + 0.002 * rng.standard_normal(24), 0.03, 0.02)
    exact = RestSettings(stiffness_spread=1e-6, natural_length_sigma_m=1e-7)
    return mechanics, rest_step(structure, mechanics, None, GeometrySigma(), exact).node_position_m


class TestLengthsAtRest:
    """Nobody measured the rest shape: the lengths at rest tell it, with the balance of forces."""

    def found(self, structure, told, at_rest_m, errors_m=0.0):
        length_m = structure.tendon_length_m(at_rest_m) + errors_m
        lengths = RestLengths(2.0, length_m, np.full(24, 0.0003))
        return rest_step(structure, told, None, GeometrySigma(), RestSettings(), lengths=lengths)

    def test_exact_lengths_tell_shape_and_balance(self, structure, true) -> None:
        mechanics, at_rest_m = true
        found = self.found(structure, replace(mechanics, stiffness_n_per_m=np.full(24, K)), at_rest_m)
        assert (found.source, found.wrong) == ("lengths", ())
        assert np.linalg.norm(found.node_position_m - at_rest_m, axis=1).max() < 0.0005
        assert found.unbalanced_n[1] < 0.002

    def test_natural_lengths_that_are_told_wrongly_by_millimetres_are_found(self, structure) -> None:
        """Without lengths at rest, forces would put the nodes several millimetres off."""
        error_m = 0.004 * np.random.default_rng(6).standard_normal(24)
        mechanics = Mechanics(np.full(24, K), structure.natural_length_m + error_m, 0.03, 0.02)
        exact = RestSettings(stiffness_spread=1e-6, natural_length_sigma_m=1e-7)
        at_rest_m = rest_step(structure, mechanics, None, GeometrySigma(), exact).node_position_m
        found = self.found(structure, nominal(structure), at_rest_m)
        alone = rest_step(structure, nominal(structure), None, GeometrySigma(), RestSettings())
        assert found.wrong == ("natural lengths",)
        assert not found.is_doubted
        assert np.linalg.norm(found.node_position_m - at_rest_m, axis=1).max() < 0.001
        assert np.linalg.norm(alone.node_position_m - at_rest_m, axis=1).max() > 0.003

    @pytest.mark.parametrize("wrong", [[9], [9, 17]])
    def test_sensors_that_are_wrong_do_not_count(self, structure, true, wrong) -> None:
        mechanics, at_rest_m = true
        errors_m = np.zeros(24)
        errors_m[wrong] = 0.015
        found = self.found(structure, mechanics, at_rest_m, errors_m)
        assert found.wrong == ()
        assert np.linalg.norm(found.node_position_m - at_rest_m, axis=1).max() < 0.001

    @pytest.mark.parametrize(("wrong", "error_m"), [([9, 13, 17], 0.03), ([4, 9, 13, 17, 20], 0.01)])
    def test_more_sensors_that_are_wrong_are_doubted(self, structure, true, wrong, error_m) -> None:
        """Whatever is taken as wrong, rods, anchors or natural lengths, the rest contradicts it."""
        mechanics, at_rest_m = true
        errors_m = np.zeros(24)
        errors_m[wrong] = error_m
        found = self.found(structure, mechanics, at_rest_m, errors_m)
        assert np.linalg.norm(found.node_position_m - at_rest_m, axis=1).max() > 0.005
        assert found.is_doubted

    @pytest.mark.parametrize("read", [[], [9], list(range(24))])
    def test_lengths_that_may_all_be_as_wrong_are_no_endless_search(self, structure, true, read) -> None:
        """None or one was read, or all are known to 50 mm, as of a structure that moved by that in its rest."""
        mechanics, at_rest_m = true
        sigma_m = np.full(24, 0.05 if len(read) > 1 else 0.0003)
        length_m = np.where(np.isin(np.arange(24), read), structure.tendon_length_m(at_rest_m), np.nan)
        lengths = RestLengths(2.0, length_m, np.where(np.isnan(length_m), np.nan, sigma_m))
        found = rest_step(structure, mechanics, None, GeometrySigma(), RestSettings(), lengths=lengths)
        assert np.linalg.norm(found.node_position_m - at_rest_m, axis=1).max() < 0.01

    def test_its_covariance_is_honest(self, structure) -> None:
        """All drawn as assumed: the squared error over its covariance is one per coordinate."""
        rng, nees = np.random.default_rng(5), []
        exact = RestSettings(stiffness_spread=1e-6, natural_length_sigma_m=1e-7)
        for _ in range(12):
            length_m = structure.natural_length_m + 0.0003 * rng.standard_normal(24)
            true = Mechanics(K * np.exp(0.1 * rng.standard_normal(24)), length_m, 0.03, 0.02)
            at_rest_m = rest_step(structure, true, None, GeometrySigma(), exact).node_position_m
            found = self.found(structure, nominal(structure), at_rest_m, 0.0003 * rng.standard_normal(24))
            error = (found.node_position_m - at_rest_m)[3:].ravel()
            nees.append(error @ np.linalg.pinv(found.covariance_m2[9:, 9:], 1e-9) @ error / 21)
        assert 0.5 < np.mean(nees) < 1.5

    def test_lengths_of_no_shape_are_told(self, structure, true) -> None:
        """All are 12 mm too long, those between anchors too, as from hooks that were not counted."""
        mechanics, at_rest_m = true
        lengths = RestLengths(2.0, structure.tendon_length_m(at_rest_m), np.full(24, 0.0003))
        assert not self.found(structure, mechanics, at_rest_m).misfits(lengths)
        longer = replace(lengths, length_m=lengths.length_m + 0.012)
        assert self.found(structure, mechanics, at_rest_m, 0.012).misfits(longer)


class TestInAHand:
    """A structure without anchors and floor: a body, which has no place."""

    def in_a_hand(self, structure):
        return replace(structure, anchors=np.zeros(0, dtype=np.int64), anchor_position_m=np.zeros((0, 3)))

    def test_positions_that_are_told_about_leave_the_shape_alone_uncertain(self, structure, true) -> None:
        """Without anchors, by 0.2 m and more before, as much as where it may be."""
        mechanics, at_rest_m = true
        body = self.in_a_hand(structure)
        near_m = at_rest_m + 0.005 * np.random.default_rng(1).standard_normal((12, 3))
        found = rest_step(body, mechanics, None, GeometrySigma(), RestSettings(), near_position_m=near_m)
        assert found.wrong == ()
        assert found.largest_sigma_m < 0.005
        assert (np.linalg.eigvalsh(found.covariance_m2) > 0).all()

    def test_its_mirror_image_is_doubted_also_where_natural_lengths_are_mended(self, structure) -> None:
        error_m = 0.004 * np.random.default_rng(6).standard_normal(24)
        mechanics = Mechanics(np.full(24, K), structure.natural_length_m + error_m, 0.03, 0.02)
        exact = RestSettings(stiffness_spread=1e-6, natural_length_sigma_m=1e-7)
        at_rest_m = rest_step(structure, mechanics, None, GeometrySigma(), exact).node_position_m
        lengths = RestLengths(2.0, structure.tendon_length_m(at_rest_m), np.full(24, 0.0003))
        body = self.in_a_hand(structure)
        found = rest_step(body, nominal(body), None, GeometrySigma(), RestSettings(), lengths=lengths)
        assert found.wrong == ("mirror",)


@pytest.fixture(scope="module")
def measured(balanced):
    """The rest shape, measured to 0.3 mm."""
    return balanced.node_position_m + 0.0003 * np.random.default_rng(8).standard_normal((12, 3))


class TestWrongGeometry:
    """What is told of the geometry is wrong in one part: the evidence names it, and the shape is better for it."""

    def found(self, told, measured):
        return rest_step(told, nominal(told), measured, GeometrySigma(), RestSettings())

    def test_nothing_is_blamed_when_all_agrees(self, structure, measured) -> None:
        assert self.found(structure, measured).wrong == ()

    def test_rods(self, structure, balanced, measured) -> None:
        wrong_m = structure.rod_length_m + 0.0015 * np.array([1, -1, 1, 1, -1, -1])
        found = self.found(replace(structure, rod_length_m=wrong_m), measured)
        assert found.wrong == ("rods",)
        np.testing.assert_allclose(found.structure.rod_length_m, structure.rod_length_m, atol=0.0008)

    def test_anchors(self, structure, balanced, measured) -> None:
        shift = 0.002 * np.array([[1, 0, 0.5], [-1, 0.5, 0], [0, -1, 1]])
        told = replace(structure, anchor_position_m=structure.anchor_position_m + shift)
        found = self.found(told, measured)
        assert found.wrong == ("anchors",)
        np.testing.assert_allclose(found.structure.anchor_position_m, structure.anchor_position_m, atol=0.001)

    @pytest.mark.parametrize(("shape_m", "wrong"), [(0.0, ("rods", "anchors")), (0.002, ("anchors", "rest shape"))])
    def test_anchors_and_another_part(self, shape_m, wrong, structure, balanced, measured) -> None:
        """What is uncertain of both is in the covariance."""
        shift = 0.003 * np.array([[1, 0, 1], [-1, 0.5, 0], [0, -1, -1]])
        rod_m = 0.0 if shape_m else 0.0015
        told = replace(
            structure,
            anchor_position_m=structure.anchor_position_m + shift,
            rod_length_m=structure.rod_length_m + rod_m * np.array([1, -1, 1, 1, -1, -1]),
        )
        found = self.found(told, measured + shape_m * np.random.default_rng(9).standard_normal((12, 3)))
        assert found.wrong == wrong
        assert found.is_doubted
        error_m = (found.node_position_m - balanced.node_position_m).ravel()
        squared = error_m @ np.linalg.solve(found.covariance_m2 + 1e-10 * np.eye(36), error_m)
        assert squared < chi2.ppf(0.99, 36)

    def test_measured_shape(self, structure, balanced, measured) -> None:
        off = measured + 0.003 * np.random.default_rng(9).standard_normal((12, 3))
        found = self.found(structure, off)
        assert found.wrong == ("rest shape",)
        assert np.linalg.norm(found.node_position_m - balanced.node_position_m) < 0.7 * np.linalg.norm(
            off - balanced.node_position_m
        )

    @pytest.mark.parametrize("turn_rad", [[0.035, 0, 0], [0, 0, 0.035], [0.02, -0.05, 0]])
    def test_a_shape_measured_in_other_axes_than_the_anchors(self, turn_rad, structure, balanced, measured) -> None:
        """Turned by 2 to 3 degrees: the shape is that in the axes of the anchors, and in doubt."""
        middle_m = measured.mean(axis=0)
        found = self.found(structure, (measured - middle_m) @ rotation(np.array(turn_rad)).T + middle_m + 0.002)
        assert found.wrong == ("axes",)
        assert found.is_doubted
        assert np.abs(found.node_position_m - balanced.node_position_m).max() < 0.002

    def test_an_anchor_told_too_high_is_no_other_than_tilted_axes(self, structure, measured) -> None:
        shift = np.array([[0, 0, 0.003], [0, 0, 0], [0, 0, 0]])
        told = replace(structure, anchor_position_m=structure.anchor_position_m + shift)
        assert self.found(told, measured).is_doubted

    def test_hubs_that_were_told_widen_the_balance(self, structure, measured) -> None:
        hubs = GeometrySigma(hub_radius_m=0.0075)
        found = rest_step(structure, nominal(structure), measured, hubs, RestSettings())
        length_m = structure.tendon_length_m(measured)
        per_m = np.sqrt(np.mean((K * (length_m - structure.natural_length_m) / length_m) ** 2) * 4 / 3)
        assert found.hub_force_n == pytest.approx(0.0075 * per_m, rel=0.05)
        statics = Statics(found.structure, found.mechanics)
        assert np.abs(statics.residual_n(found.node_position_m)).max() < 1e-9  # what hubs leave is subtracted


@pytest.mark.parametrize(
    ("floor", "wrong"),
    [
        (Floor(0.010, UP), ()),
        (Floor(0.013, UP), ("floor",)),
        (Floor(0.007, UP), ("floor",)),
        (Floor(0.010, TILTED), ("floor",)),
        (Floor(0.010, TILTED, normal_sigma_rad=0.17), ()),
    ],
)
def test_a_floor_on_which_the_rest_shape_does_not_stand(floor: Floor, wrong: tuple[str, ...]) -> None:
    """Its height is wrong by 3 mm, or its normal by 1.5 degrees, unless that is estimated."""
    trial = open_trial(ROLL).description
    found = rest_step(
        trial.structure, trial.mechanics, trial.rest_position_m, trial.geometry, RestSettings(), floor, None
    )
    assert found.wrong == wrong
    assert found.is_doubted == bool(wrong)


def test_a_floor_that_carries_nothing_at_a_node_is_no_obstacle() -> None:
    """Of three nodes, one told 0.16 m too high, the centroid is outside: the third bears no load, and no friction."""
    trial = open_trial(ROLL).description
    x = trial.rest_position_m.copy()
    x[5, 2] = 0.17
    found = rest_step(trial.structure, trial.mechanics, x, trial.geometry, RestSettings(), trial.floor, None)
    assert np.isfinite(found.node_position_m).all()
