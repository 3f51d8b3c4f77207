"""Motors that shorten tendons: the estimators follow where natural lengths are told, and say doubt where not."""

from dataclasses import replace

import numpy as np
import pytest

from balance import K, pressed
from tensegraph import Settings, Status
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.graph import GraphBuilder
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.models.estimation import NoiseSettings
from tensegraph.models.values.readings import NaturalLengths

WOUND = [15, 20, 23]
SIGMA_M = 1e-4


def wound(rest, share: float):
    """Return the natural lengths with three tendons shortened by a share of 12 mm."""
    length_m = rest.structure.natural_length_m.copy()
    length_m[WOUND] -= share * 0.012
    sigma_m = np.zeros(len(length_m))
    sigma_m[WOUND] = SIGMA_M
    return NaturalLengths(length_m, sigma_m)


@pytest.fixture(scope="module")
def wound_shapes(structure, balanced):
    """(share, true shape): no load, and forces balance with the natural lengths of each."""
    shapes = []
    for share in np.linspace(0, 1, 13):
        change_m = wound(balanced, share).length_m - structure.natural_length_m
        mechanics = replace(balanced.mechanics, natural_length_m=balanced.mechanics.natural_length_m + change_m)
        shapes.append((share, pressed(structure, replace(balanced, mechanics=mechanics), np.zeros((12, 3)))))
    return shapes


@pytest.mark.parametrize("estimator", [FrameEstimator, LiveSmoother, BatchOptimizer])
def test_a_structure_that_motors_move_is_followed(estimator, structure, balanced, lengths_of, wound_shapes) -> None:
    """Every frame has its own natural lengths, and no load where forces balance with them."""
    frames = [
        replace(lengths_of(structure, x, 0.1 * k, 2e-4), natural=wound(balanced, share))
        for k, (share, x) in enumerate(wound_shapes)
    ]
    exact = replace(balanced, covariance_m2=1e-4 * balanced.covariance_m2)
    assert np.abs(wound_shapes[-1][1] - balanced.node_position_m).max() > 0.005
    shapes = estimator(structure, exact, Settings()).estimate(frames)
    for shape, (_, true_m) in zip(shapes, wound_shapes, strict=True):
        assert np.abs(shape.node_position_m - true_m).max() < 0.0005
        assert np.nanmax(np.abs(shape.loads.force_n)) < 0.1
        assert shape.status is Status.OK


def test_what_is_not_told_looks_like_loads_and_is_doubted(structure, balanced, lengths_of, wound_shapes) -> None:
    """Three seconds after: the lengths are exact, but forces do not balance at six nodes."""
    true_m = wound_shapes[-1][1]
    frames = [lengths_of(structure, balanced.node_position_m, 0.1 * k, 2e-4) for k in range(5)]
    frames += [lengths_of(structure, true_m, 0.5 + 0.1 * k, 2e-4) for k in range(30)]
    *_, last = LiveSmoother(structure, balanced, Settings()).estimate(frames)
    assert last.status is not Status.OK


def test_the_sigma_of_a_natural_length_is_one_of_forces(structure, balanced, lengths_of) -> None:
    """A sigma of 1 mm at one tendon is 0.4 N at its two ends, across the rods, on two of three axes."""
    builder = GraphBuilder(structure, replace(balanced, mechanics_covariance=None), NoiseSettings())
    natural = NaturalLengths(structure.natural_length_m, np.where(np.arange(24) == 15, 0.001, 0.0))
    before = builder.force_sigma_n**2
    builder.wind(natural)
    more_n2 = builder.force_sigma_n**2 - before
    k, x = balanced.mechanics.stiffness_n_per_m[15], balanced.node_position_m
    for node, other in (structure.tendons[15], structure.tendons[15][::-1]):
        along = (x[other] - x[node]) / np.linalg.norm(x[other] - x[node])
        rod = structure.rods[(structure.rods == node).any(axis=1)][0]
        w = (x[rod[1]] - x[rod[0]]) / np.linalg.norm(x[rod[1]] - x[rod[0]])
        across_n = k * 0.001 * np.linalg.norm(along - w * (w @ along))
        at = np.flatnonzero(builder.statics.nodes == node)[0]
        assert more_n2[3 * at] == pytest.approx(across_n**2 / 2)
    assert k == pytest.approx(K, rel=0.3)
    untouched = np.setdiff1d(builder.statics.nodes, structure.tendons[15])
    for node in untouched:
        assert more_n2[3 * np.flatnonzero(builder.statics.nodes == node)[0]] == pytest.approx(0, abs=1e-12)


def test_the_variance_follows_a_sigma_that_changes(structure, balanced) -> None:
    builder = GraphBuilder(structure, balanced, NoiseSettings())
    builder.wind(NaturalLengths(structure.natural_length_m, np.full(24, 1e-4)))
    exact = builder.force_sigma_n.copy()
    builder.wind(NaturalLengths(structure.natural_length_m, np.full(24, 5e-4)))
    assert (builder.force_sigma_n > 1.2 * exact).all()
