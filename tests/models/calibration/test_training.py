"""Training: quick, on recordings of a sensor whose law is known."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from lagging_sensor import lagging_sensor
from tensegraph import InputError, TensegraphError
from tensegraph.models.calibration.calibrated_model import CURVE, LSTM, STATIC, calibrate_model
from tensegraph.models.calibration.recipe import CHECK_EVERY, TrainingSettings
from tensegraph.models.calibration.recordings import Recording, Split
from tensegraph.models.calibration.strip_scores import StripScore
from tensegraph.models.calibration.training import train
from tensegraph.models.sensor.bending import BendingCurve
from tensegraph.models.sensor.lstm import CURVE_MEMORIES, MEMORY_S, Scaling, features
from tensegraph.models.sensor.stretching import StretchingSensors

QUICK = TrainingSettings(epochs=120, sequences=12, steps=400, hidden=8)


GAINS = (1.1, 0.9, 1.05, 0.95, 1.0, 0.97)


TINY = TrainingSettings(epochs=20, sequences=4, steps=200, chunk=50, hidden=4)


def recording(k: int, seconds: float = 75.0, **law: float) -> Recording:
    """Seventy-five seconds at 10 Hz: time and samples enough to tell the gain of each strip within 2 %."""
    return lagging_sensor(f"random_s{k}", k, seconds=seconds, rate_hz=10.0, **law)


def fit(split: Split, settings: TrainingSettings, **kwargs):
    return train(split, BendingCurve(), settings, **kwargs)


@pytest.fixture(scope="module")
def split():
    return Split.by_recordings([recording(k, gain=gain) for k, gain in enumerate(GAINS)])


@pytest.fixture(scope="module")
def calibrated(split):
    epochs = []
    trained = fit(split, QUICK, progress=lambda epoch, loss: epochs.append(epoch))
    return calibrate_model(split, trained, None, QUICK), epochs


def test_the_network_undoes_a_lag_that_the_curve_can_not(calibrated) -> None:
    calibration, epochs = calibrated
    scores = {name: StripScore.of(runs) for name, runs in calibration.runs.items()}
    assert scores[LSTM].rmse < 0.6 * scores[STATIC].rmse
    assert 0.85 < scores[LSTM].coverage_95 <= 1.0
    assert epochs == list(range(1, QUICK.epochs + 1))


def test_validation_chooses_between_the_network_and_the_curve(split, calibrated) -> None:
    """A network that undoes the lag is used; one whose correction is turned round is not, and the curve is alone."""
    good = calibrated[0]
    assert good.validation_rmse[0] < good.validation_rmse[1]
    assert good.model.network.weights is good.trained.weights
    weights = good.trained.weights
    turned = replace(weights, head_weight=weights.head_weight * np.array([[-1.0], [1.0]]))
    parts = (tuple(r.part(0, 0.4) for r in each) for each in (split.training, split.validation, split.held_out))
    poor = calibrate_model(Split(*parts, split.how), replace(good.trained, weights=turned), None, QUICK)
    assert poor.validation_rmse[1] < poor.validation_rmse[0]
    assert not poor.model.network.weights.head_weight[0].any()
    assert good.used == LSTM
    assert poor.used == CURVE
    assert StripScore.of(poor.runs[CURVE]).rmse < StripScore.of(poor.runs[LSTM]).rmse


def test_a_training_that_diverges_is_refused(split) -> None:
    """All losses are nan: the weights would be those of the start."""
    settings = replace(TINY, learning_rate=1e10)
    with pytest.raises(TensegraphError, match=r"the training diverged: expected a smaller learning rate, got 1e\+10"):
        calibrate_model(split, fit(split, settings), None, settings)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"noise": (0.1, 0.05)}, r"noise: expected \[least, most\], got \[0.1, 0.05\]"),
        ({"steps": 20}, "burn_in: expected less than steps = 20, got 20"),
    ],
)
def test_settings_that_make_no_training_are_refused(settings, message) -> None:
    with pytest.raises(InputError, match=message):
        TrainingSettings(**settings)


def test_gains_are_found_along_with_the_network(calibrated) -> None:
    """In proportion: one gain for all is the curve's. The last two strips validate and test."""
    own = calibrated[0].trained.gain_and_offset
    gains = np.array([own[f"random_s{k}"][0] for k in range(4)])
    np.testing.assert_allclose(gains / gains.mean(), np.array(GAINS[:4]), rtol=0.03)
    assert 0.03 < calibrated[0].trained.gauge.gain_sigma < 0.1


def test_the_network_s_input_in_torch_is_that_in_numpy() -> None:
    import torch

    from tensegraph.models.calibration.torch_network import network_input

    rng = np.random.default_rng(0)
    change, rate, means = rng.normal(size=(4, 50)), rng.normal(size=(4, 50)), rng.normal(size=(4, 50, len(MEMORY_S)))
    step_s, scaling = rng.uniform(0.01, 0.1, size=(4, 1)), Scaling(0.1, 0.3, 0.2, 0.03)
    tensors = [torch.tensor(values) for values in (change, rate, step_s, means)]
    expected = features(change, rate, step_s, means, scaling)
    np.testing.assert_allclose(network_input(*tensors, scaling).numpy(), expected, rtol=1e-12)


def test_held_out_recordings_are_kept_out(calibrated) -> None:
    calibration, _ = calibrated
    assert calibration.model.provenance.trained_on == tuple(f"random_s{k}" for k in range(4))
    assert [r.name for r in calibration.split.validation] == ["random_s4"]
    assert [run.name for run in calibration.runs[LSTM]] == ["random_s5"]


def test_running_needs_no_torch_and_gives_what_torch_gives(calibrated) -> None:
    """`SensorModel` in numpy against torch's LSTM with the same weights, over 200 steps of 24 sensors: 1e-6."""
    import torch

    model = calibrated[0].model
    weights = {name: torch.tensor(value) for name, value in asdict(model.network.weights).items()}
    reference, head = (
        torch.nn.LSTM(3 + len(MEMORY_S), QUICK.hidden, batch_first=True).double(),
        torch.nn.Linear(QUICK.hidden, 2).double(),
    )
    with torch.no_grad():
        for name, value in {
            "weight_ih_l0": weights["weight_ih"],
            "weight_hh_l0": weights["weight_hh"],
            "bias_ih_l0": weights["bias"],
            "bias_hh_l0": torch.zeros_like(weights["bias"]),
        }.items():
            getattr(reference, name).copy_(value)
        head.weight.copy_(weights["head_weight"])
        head.bias.copy_(weights["head_bias"])
    weight = 1 - np.exp(-0.02 / np.array(MEMORY_S))
    change = 0.1 + np.cumsum(0.01 * np.random.default_rng(1).standard_normal((200, 24)), axis=0)
    rate = np.diff(change, axis=0, prepend=change[:1]) / 0.02
    sensors, s = StretchingSensors(model, 24), model.network.scaling
    strain = sensors.run(change, rate, np.full((len(change), 1), 0.02)).strain
    step = np.full_like(change, np.log(0.02 / s.step_s))
    means = np.zeros((24, len(MEMORY_S)))  # as those of a sensor never read
    away = [change[k, :, None] - (means := means + (change[k, :, None] - means) * weight) for k in range(200)]
    now = np.stack([(change - s.change_middle) / s.change, rate / s.rate_per_s, step], axis=-1)
    x = np.concatenate([now, np.array(away) / s.change], axis=-1)
    with torch.no_grad():
        output = head(reference(torch.tensor(x.swapaxes(0, 1)))[0]).numpy().swapaxes(0, 1)
    curve_means = change[..., None] - np.array(away)[..., :CURVE_MEMORIES]
    expected = model.curve.estimate(change, curve_means)[0] + 0.05 * output[..., 0]
    np.testing.assert_allclose(strain, expected, atol=1e-6)


def test_the_curve_trained_on_is_the_one_run(calibrated) -> None:
    import torch

    from tensegraph.models.calibration.torch_network import curve_strain

    curve, rng = calibrated[0].model.curve, np.random.default_rng(0)
    change, means = rng.uniform(-0.1, 0.5, 300), rng.uniform(-0.1, 0.5, (300, CURVE_MEMORIES))
    trained = curve_strain(curve, torch.tensor(change).float(), torch.tensor(means).float()).numpy()
    np.testing.assert_allclose(trained, curve.estimate(change, means)[0], atol=1e-5)


class Kept:
    """A checkpoint in memory."""

    def __init__(self) -> None:
        self.state: bytes | None = None

    def load(self) -> bytes | None:
        return self.state

    def save(self, state: bytes) -> None:
        self.state = state


def test_the_same_seed_gives_the_same_model(split) -> None:
    one, other, third = (fit(split, TINY), fit(split, TINY), fit(split, TrainingSettings(**{**_dict(TINY), "seed": 1})))
    np.testing.assert_array_equal(one.weights.weight_ih, other.weights.weight_ih)
    assert not np.array_equal(one.weights.weight_ih, third.weights.weight_ih)


@pytest.mark.parametrize("epoch", [CHECK_EVERY, 2 * CHECK_EVERY + 3])
def test_an_interrupted_training_goes_on_to_the_same_model(split, epoch: int) -> None:
    whole, kept, seen = fit(split, TINY), Kept(), []

    def interrupt(now: int, loss: float) -> None:
        if now == epoch + 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit(split, TINY, progress=interrupt, checkpoint=kept)
    resumed = fit(split, TINY, progress=lambda now, loss: seen.append(now), checkpoint=kept)
    assert seen[0] == epoch // CHECK_EVERY * CHECK_EVERY + 1
    for name, value in asdict(whole.weights).items():
        np.testing.assert_array_equal(getattr(resumed.weights, name), value)
    assert resumed.history == whole.history


def test_a_checkpoint_of_other_settings_is_not_used(split) -> None:
    kept, seen = Kept(), []
    fit(split, TINY, checkpoint=kept)
    other = TrainingSettings(**{**_dict(TINY), "seed": 1})
    fit(split, other, progress=lambda now, loss: seen.append(now), checkpoint=kept)
    assert seen[0] == 1


@pytest.mark.parametrize("saved", [b"", b"notes", b"PK\x03\x04", b"\x80\x02.", b"N."])
def test_what_is_no_checkpoint_is_not_used(split, saved: bytes) -> None:
    kept, seen = Kept(), []
    kept.save(saved)
    once = replace(TINY, epochs=1)
    fit(split, once, progress=lambda now, loss: seen.append(now), checkpoint=kept)
    assert seen == [1]
    fit(split, once, progress=lambda now, loss: seen.append(now), checkpoint=kept)  # which has replaced it
    assert seen == [1]


def test_training_stops_when_validation_gets_no_better(split) -> None:
    impatient = replace(TINY, epochs=100, learning_rate=0.05, patience=10)
    history = fit(split, impatient).history
    assert len(history.training_loss) < impatient.epochs
    assert len(history.training_loss) - history.best_epoch >= 10


def test_one_network_for_both_modes() -> None:
    """Strain of either sign from a sensor that is linear through zero: what the split network never scores on."""
    split = Split.by_recordings([recording(0, 40.0), *(recording(k, 40.0, low=-0.2) for k in range(1, 6))])
    settings = replace(QUICK, epochs=60, unified=True)
    calibration = calibrate_model(split, fit(split, settings), None, settings)
    (run,) = calibration.runs[LSTM]
    assert (run.strain < -0.1).any()
    assert calibration.model.unified
    assert StripScore.of([run]).rmse < 0.02


def _dict(settings: TrainingSettings) -> dict:
    from dataclasses import asdict

    return asdict(settings)


@pytest.mark.parametrize("epochs", [1, 2, 3])
def test_a_training_of_few_updates_ends(split, epochs: int) -> None:
    """Ten updates, of two epochs here, are where the rise of torch's one-cycle schedule has no length."""
    few = replace(TINY, epochs=epochs, steps=250)
    assert len(fit(split, few).history.training_loss) == epochs


@pytest.mark.parametrize(("rate_hz", "step_s"), [(1.0, (0.01, 2.0)), (20.0, (0.01, 0.1)), (500.0, (0.0004, 0.1))])
def test_a_model_is_for_frames_whatever_the_rate_of_the_rig(rate_hz: float, step_s: tuple[float, float]) -> None:
    recordings = [lagging_sensor(f"s{k}", k, seconds=60.0, rate_hz=rate_hz) for k in range(2)]
    trained = fit(Split.by_time(recordings, 0.3), replace(TINY, epochs=1))
    assert trained.step_s == step_s
