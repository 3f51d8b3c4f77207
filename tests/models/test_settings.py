"""Settings of robots that are stiffer or larger than the one for which the defaults are."""

from dataclasses import replace

import numpy as np
import pytest

from balance import nominal, pressed
from tensegraph import Settings
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.models.settings import sizes_of


@pytest.mark.parametrize(
    ("stiffer", "longer", "expected"),
    [
        (1.0, 1.0, (1, 1)),
        (1.4, 1.0, (1, 1)),
        (10.0, 1.0, (8, 1)),
        (1.0, 10.0, (8, 8)),
        (0.1, 0.5, (1 / 16, 1)),
        (1e-3, 1.0, (1 / 16, 1)),
        (1e6, 1, (256, 1)),
    ],
)
def test_sizes_are_powers_of_two(structure, stiffer, longer, expected) -> None:
    """By hand: 10 times is nearest to 8; the force of a tendon grows with its length, too, and shrinks to a 16th."""
    told = replace(
        structure,
        natural_length_m=longer * structure.natural_length_m,
        rod_length_m=longer * structure.rod_length_m,
    )
    mechanics = nominal(told)
    mechanics = replace(mechanics, stiffness_n_per_m=stiffer * mechanics.stiffness_n_per_m)
    assert sizes_of(told, mechanics) == expected
    assert sizes_of(told, None) == (1, expected[1])


def test_what_was_set_stays() -> None:
    told = Settings(noise=replace(Settings().noise, force_n=0.3))
    grown = told.of_size(8.0, 4.0)
    assert grown.noise.force_n == 0.3
    assert (grown.noise.shape_prior_m, grown.doubt.load_n, grown.doubt.quiet_n) == (0.24, 12.0, 0.24)
    assert (grown.doubt.many_loads_n, grown.doubt.shaken_n, grown.rest.force_sigma_n) == (8.0, 40.0, 0.16)
    assert (grown.rest.found_sigma_m, grown.pose.floor_m, grown.pose.slip_m_per_rad05) == (0.012, 0.002, 0.028)
    assert grown.of_size(8.0, 4.0) == grown
    assert told.of_size(1.0, 1.0) == told


def test_a_press_on_a_stiff_robot_is_followed(structure, balanced, lengths_of) -> None:
    """Ten times as stiff, pressed with ten times the force: as far as the robot of the defaults; 1.5 N were no load."""
    mechanics = replace(balanced.mechanics, stiffness_n_per_m=10 * balanced.mechanics.stiffness_n_per_m)
    stiff = replace(balanced, mechanics=mechanics, mechanics_covariance=None)
    load_n = np.zeros((12, 3))
    load_n[5] = [0, 0, -30.0]
    far_m = pressed(structure, stiff, load_n)
    rng = np.random.default_rng(1)
    frames = [lengths_of(structure, far_m, 0.02 * k, noise=5e-4 * rng.standard_normal(24)) for k in range(60)]
    error_m = {}
    for size in (1.0, 8.0):
        smoother = LiveSmoother(structure, stiff, Settings().of_size(size, 1.0))
        shape = list(map(smoother.update, frames))[-1]
        error_m[size] = np.linalg.norm(shape.node_position_m - far_m, axis=1).max()
    assert error_m[8.0] < 0.003
    assert error_m[8.0] < 0.5 * error_m[1.0]
