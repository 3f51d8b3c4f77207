"""The front end of a sensor model from elsewhere: taring, sigma, missing readings, and a model that is none."""

import numpy as np
import pytest

from tensegraph import Flag, InputError, Mode
from tensegraph.models.strain_front_end import StrainFrontEnd, StrainReading
from tensegraph.models.values.readings import ResistanceFrame, RestLengths, TendonLengths

R0 = np.full(4, 1e6)
L0 = np.full(4, 0.2)
REST = RestLengths(0.1, np.full(4, 0.22), np.full(4, 0.0004))


class Halved:
    """Strain is half of dR/R."""

    def __init__(self, tendons: int, sigma: float = 0.004) -> None:
        self._sigma = np.full(tendons, sigma)

    def step(self, t_s, change):
        return StrainReading(0.5 * change, self._sigma, np.full(len(change), int(Mode.STRETCHING)))


def frame(t_s: float, change) -> ResistanceFrame:
    flags = np.where(np.isnan(change), int(Flag.MISSING), 0)
    return ResistanceFrame(t_s, R0 * (1 + np.asarray(change)), np.zeros(4), flags)


def step(front_end: StrainFrontEnd, t_s: float, change) -> TendonLengths:
    (lengths,) = front_end.lengths([frame(t_s, change)])
    return lengths


def tared(changes=(0.3, 0.3), make=Halved) -> StrainFrontEnd:
    """A front end after frames at rest."""
    front_end = StrainFrontEnd(make, R0, L0, REST)
    for k, change in enumerate(changes):
        step(front_end, 0.02 * k, np.full(4, change))
    return front_end


def test_lengths_by_hand() -> None:
    """Rest strain 0.1 at dR/R 0.3; dR/R 0.34 is 0.02 of strain more: 0.2 m (1 + 0.12). Sigma: 0.004 and 0.002."""
    lengths = step(tared(), 1.0, np.full(4, 0.34))
    np.testing.assert_allclose(lengths.length_m, 0.224, rtol=1e-12)
    np.testing.assert_allclose(lengths.sigma_m, 0.2 * np.hypot(0.004, 0.002), rtol=1e-9)
    np.testing.assert_allclose(lengths.rest_sigma_m, 0.0004)
    assert (lengths.flags == 0).all()
    assert (lengths.mode == Mode.STRETCHING).all()


def test_what_spreads_at_rest_widens() -> None:
    """Strains 0.1 and 0.2 at rest: mean 0.15, spread 0.05; 10 mm of four tendons are motion."""
    front_end = tared((0.2, 0.4))
    lengths = step(front_end, 1.0, np.full(4, 0.3))
    np.testing.assert_allclose(lengths.length_m, 0.22)
    np.testing.assert_allclose(lengths.sigma_m, 0.2 * np.sqrt(0.004**2 + 0.05**2 + 0.002**2))
    assert front_end.moved_at_rest
    assert lengths.rest_in_doubt
    assert not tared((0.3, 0.301)).moved_at_rest


def test_a_missing_reading_is_left_out_of_frame_and_taring() -> None:
    front_end = tared()
    lengths = step(front_end, 1.0, [0.3, np.nan, 0.3, 0.3])
    assert np.isnan(lengths.length_m[1])
    assert lengths.sigma_m[1] == np.inf
    assert lengths.flags[1] == Flag.MISSING
    np.testing.assert_array_equal(lengths.usable, [True, False, True, True])
    never = StrainFrontEnd(Halved, R0, L0, REST)
    step(never, 0.0, [0.3, np.nan, 0.3, 0.3])
    untared = step(never, 1.0, np.full(4, 0.34))
    np.testing.assert_allclose(untared.length_m, [0.224, 0.2 * 1.17, 0.224, 0.224])  # as the model tells it


@pytest.mark.parametrize("strain", [-1.5, 1e9, np.nan, np.inf])
def test_a_strain_that_no_tendon_has_is_left_out(strain) -> None:
    class Absurd(Halved):
        def step(self, t_s, change):
            told = super().step(t_s, change)
            told.strain[2] = strain if t_s > 0.5 else told.strain[2]
            return told

    lengths = step(tared(make=Absurd), 1.0, np.full(4, 0.3))
    np.testing.assert_array_equal(lengths.usable, [True, True, False, True])
    assert lengths.flags[2] & Flag.MISSING


@pytest.mark.parametrize(
    ("told", "message"),
    [
        (None, "expected a StrainReading from step, got NoneType"),
        (StrainReading(np.zeros(3), np.ones(4), np.zeros(4)), "strain: expected 4 numbers, one of each tendon, got"),
        (StrainReading(np.zeros(4), 1.0, np.zeros(4)), r"sigma: expected 4 numbers, .*, got shape \(\)"),
        (StrainReading(np.zeros(4), np.ones(4), np.full(4, 7)), "mode: expected 0, 1, got"),
    ],
)
def test_a_model_that_is_none_is_told_so(told, message) -> None:
    class Wrong(Halved):
        def step(self, t_s, change):
            return told

    with pytest.raises(InputError, match=message):
        tared(make=Wrong)
