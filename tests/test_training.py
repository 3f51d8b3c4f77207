"""Training: quick, on recordings of a sensor whose law is known."""

import numpy as np
import pytest

from tensegraph import InputError
from tensegraph.models.bending import BendingCurve
from tensegraph.models.gauge import Recording, fit_gauge
from tensegraph.models.training import TrainingSettings, is_held_out, train


def lagging_sensor(name: str, seed: int, *, gain=1.0, offset=0.0, lag_s=0.3, seconds=60.0, high=0.2) -> Recording:
    """Random motion of a sensor y = offset + gain 1.3 strain behind a first-order lag, read at 20 Hz."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0, seconds, 0.05)
    corners = np.cumsum(rng.uniform(0.2, 1.5, 200))
    strain = np.interp(t_s, np.concatenate([[0], corners]), np.concatenate([[0], rng.uniform(0, high, 200)]))
    lagged = np.empty_like(strain)
    lagged[0] = strain[0]
    for k in range(1, len(strain)):
        lagged[k] = strain[k] + (lagged[k - 1] - strain[k]) * np.exp(-0.05 / lag_s)
    return Recording(name, t_s, strain, offset + gain * 1.3 * lagged + 5e-4 * rng.standard_normal(len(t_s)))


@pytest.fixture(scope="module")
def recordings():
    return [lagging_sensor(f"random_small_s{k}", k, gain=1 + 0.05 * (k - 2.5)) for k in range(6)]


@pytest.fixture(scope="module")
def trained(recordings):
    epochs = []
    settings = TrainingSettings(epochs=60, sequences=16, steps=800, hidden=8)
    return train(recordings, settings, lambda epoch, loss: epochs.append((epoch, loss))), epochs


def test_gauge_of_a_static_sensor_is_recovered() -> None:
    """Gains of 0.9 and 1.1 about one straight line, without lag."""
    recordings = [lagging_sensor(f"r{k}", k, gain=gain, lag_s=1e-3) for k, gain in enumerate([0.9, 1.0, 1.1])]
    gauge, own = fit_gauge(recordings, BendingCurve())
    strain = np.array([0.05, 0.1, 0.15])
    np.testing.assert_allclose(gauge.change(strain, BendingCurve()), 1.3 * strain, rtol=0.02)
    gains = np.array([own[f"r{k}"][0] for k in range(3)])
    np.testing.assert_allclose(gains / gains.mean(), [0.9, 1.0, 1.1], rtol=0.02)


def test_the_network_undoes_a_lag_that_the_curve_can_not(trained) -> None:
    model, epochs = trained
    (scores,) = model.metadata["held_out"].values()
    assert scores["rmse_strain"] < 0.6 * scores["static_rmse_strain"]
    assert 0.85 < scores["coverage_95"] <= 1.0
    assert [epoch for epoch, _ in epochs] == list(range(1, 61))


def test_held_out_recordings_are_kept_out(trained) -> None:
    model, _ = trained
    assert model.metadata["trained_on"] == [f"random_small_s{k}" for k in range(5)]
    assert list(model.metadata["held_out"]) == ["random_small_s5"]
    assert is_held_out("stretch_0.05_s1")
    assert not is_held_out("stretch_0.10_s2")


def test_the_same_seed_gives_the_same_model(recordings) -> None:
    settings = TrainingSettings(epochs=2, sequences=4, steps=200, chunk=50)
    one, other = train(recordings, settings), train(recordings, settings)
    np.testing.assert_array_equal(one.tensors["weight_ih"], other.tensors["weight_ih"])


def test_nothing_to_train_on_is_refused(recordings) -> None:
    with pytest.raises(InputError, match="no recording"):
        train([recordings[5]], TrainingSettings(epochs=1))
