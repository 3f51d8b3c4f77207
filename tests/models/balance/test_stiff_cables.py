"""Stiff cables: their tension is unknown while they may be taut, and zero while they are slack."""

import numpy as np
import pytest

from structures import TOWER, TOWER_M
from tensegraph import Structure, saddle_tower
from tensegraph.factors.tendon import SLACK, TautCables
from tensegraph.models.balance.statics import Statics
from tensegraph.models.structure.floor import GRAVITY_M_PER_S2
from tensegraph.models.structure.mechanics import Mechanics

STIFF_N_PER_M = 2e4
SADDLE, SADDLE_M = saddle_tower(0.3, 0.15)


def with_cables(structure: Structure, x: np.ndarray, cables: list[int], shorter_m: float = 0.0) -> Statics:
    """Tendons of 400 N/m, of which some are cables that are as long as they are at a shape, or somewhat longer."""
    stiffness, natural_m = np.full(len(structure.tendons), 400.0), structure.natural_length_m.copy()
    stiffness[cables] = STIFF_N_PER_M
    natural_m[cables] = structure.tendon_length_m(x)[cables] + shorter_m
    push_back = np.where(stiffness > 400.0, 0.0, 0.1)
    return Statics(structure, Mechanics(stiffness, natural_m, 0.03, push_back, stiff_cables=np.array(cables)))


def knot() -> tuple[Structure, np.ndarray]:
    """A node that hangs by a cable of 0.2 m from an anchor, and is drawn sideways by a strip."""
    anchor_m = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, -0.2], [0.0, 0.3, 0.0]])
    structure = Structure(
        rods=np.array([(0, 1), (0, 2)]), tendons=np.array([(0, 3), (1, 3)]),
        rod_length_m=np.array([np.hypot(0.3, 0.2), 0.3]),
        natural_length_m=np.array([0.2, 0.29]), anchors=np.arange(3), anchor_position_m=anchor_m,
    )  # fmt: skip
    return structure, np.vstack([anchor_m, [0.0, 0.0, -0.2]])


@pytest.mark.parametrize(
    ("up_m", "kept"), [(0.0, [True, True, False]), (0.001, [True, True, False]), (0.004, [True] * 3)]
)
def test_a_knot_by_hand(up_m: float, kept: list[bool]) -> None:
    """400 N/m by 10 mm are 4 N along x; a weight of 0.1 kg is along the cable, and only seen while that is slack."""
    structure, x = knot()
    x = x + np.array([[0, 0, 0]] * 3 + [[0, 0, up_m]])
    told = Mechanics(np.array([STIFF_N_PER_M, 400.0]), structure.natural_length_m, 0.0, 0.0, knot_mass_kg=0.1,
                     stiff_cables=np.array([0]))  # fmt: skip
    strip_m = np.array([0.3, 0.0, -up_m])
    length_m = np.linalg.norm(strip_m)
    force_n = 400.0 * (length_m - 0.29) * strip_m / length_m - np.array([0, 0, 0.1 * GRAVITY_M_PER_S2])
    np.testing.assert_allclose(Statics(structure, told).residual_n(x), np.where(kept, force_n, 0.0), atol=1e-9)


@pytest.mark.parametrize(("structure", "x"), [(SADDLE, SADDLE_M), (TOWER, TOWER_M)], ids=["single rods", "joined rods"])
def test_jacobians(structure: Structure, x: np.ndarray, check_jacobian) -> None:
    """Of three cables the last one is slack."""
    statics = with_cables(structure, x, [4, 9, 12])
    natural_m = statics.mechanics.natural_length_m.copy()
    natural_m[12] += 0.02
    statics = statics.wound(natural_m)
    moved_m = x + np.random.default_rng(0).normal(0, 3e-4, x.shape)
    residual, jacobian = statics.residual_and_jacobian(moved_m)
    np.testing.assert_allclose(residual, statics.residual_n(moved_m), atol=1e-9)
    check_jacobian(statics.residual_n, jacobian, moved_m, step=1e-7, tolerance=1e-3)
    np.testing.assert_allclose(statics.residual_and_jacobian(np.stack([x, moved_m]))[1][1], jacobian, atol=1e-6)
    elastic = statics.mechanics_jacobian(moved_m)[1]
    check_jacobian(lambda by: statics.wound(natural_m + by).residual_n(moved_m), elastic, np.zeros(len(natural_m)),
                   step=1e-7, tolerance=1e-3)  # fmt: skip


def test_frames_of_other_natural_lengths_are_each_as_if_alone() -> None:
    """Motors wind strips beside stiff cables; all frames at once are what one after another are."""
    statics = with_cables(SADDLE, SADDLE_M, [4, 9])
    natural_m = statics.mechanics.natural_length_m + 0.001 * np.arange(3)[:, None] * (np.arange(24) == 7)
    shapes_m = SADDLE_M + 0.001 * np.arange(3)[:, None, None]
    together = statics.wound(natural_m).residual_and_jacobian(shapes_m)
    for k in range(3):
        for stacked, alone in zip(
            together, statics.wound(natural_m[k]).residual_and_jacobian(shapes_m[k]), strict=True
        ):
            np.testing.assert_allclose(stacked[k], alone, atol=1e-12)


def test_whatever_taut_cables_pull_changes_nothing() -> None:
    """In balance with cables of any tension, and out of it with the same cables slack."""
    cables = [12, 13, 14, 15, 16, 17]
    tight, loose = (with_cables(SADDLE, SADDLE_M, cables, shorter_m) for shorter_m in (0.0, 0.001))
    np.testing.assert_allclose(tight.residual_n(SADDLE_M), loose.residual_n(SADDLE_M), atol=1e-9)
    weightless = Mechanics(np.full(24, 400.0), SADDLE.natural_length_m, 0.0, 0.0, stiff_cables=np.array(cables))
    taut = Statics(SADDLE, weightless)
    assert np.abs(taut.residual_n(SADDLE_M)).max() < 1e-6
    longer_m = SADDLE.natural_length_m + np.where(np.isin(np.arange(24), cables), 0.3, 0.0)
    assert np.abs(taut.wound(longer_m).residual_n(SADDLE_M)).max() > 1.0
    assert taut.rank == 6 * 3 + 3 - len(cables)


def test_rows_of_lengths_by_hand() -> None:
    """2 mm longer and 1 mm shorter are taut; 4 sigma shorter says nothing. Sigma: 0.3 mm, and 10 N over 20 kN/m."""
    statics = with_cables(SADDLE, SADDLE_M, [6, 7, 8])
    natural_m = statics.mechanics.natural_length_m.copy()
    sigma_m = np.hypot(0.0003, 0.0005)
    natural_m[6:9] += [-0.002, 0.001, (SLACK + 1) * sigma_m]
    told = Structure(SADDLE.rods, SADDLE.tendons, SADDLE.rod_length_m, natural_m, SADDLE.anchors,
                     SADDLE.anchor_position_m)  # fmt: skip
    rows = TautCables.of(told, statics.mechanics, by_forces=False).rows(np.zeros(()), SADDLE_M)
    np.testing.assert_allclose(rows.residual, [0.002, -0.001, np.nan], atol=1e-12)
    np.testing.assert_allclose(rows.sigma, [sigma_m, sigma_m, np.inf])
