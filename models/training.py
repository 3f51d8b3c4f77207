"""Training of the stretching network, eqs. (10)-(15), on calibration recordings. The one module that imports torch."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from .bending import BendingCurve
from .errors import InputError
from .gauge import SETTLING_SAMPLES, Recording, StaticGauge, fit_gauge
from .mode import fit_mode
from .sensor_model import FORMAT, SensorModel, StrainSpread, StretchingSensors, run_lstm
from .stretching import LOG_VARIANCE_RANGE, STRAIN_SCALE, Lstm, features

WORKING_STRAIN = 0.3
"""Tendons of a tensegrity are strained by 0.08 at rest, and by less than this when pressed hard."""


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """The training recipe; defaults were chosen on held-out calibration recordings."""

    epochs: int = 400
    learning_rate: float = 0.01
    """Peak of a one-cycle schedule, Adam."""
    hidden: int = 16
    sequences: int = 32
    """Random sequences an epoch, each with its own time step."""
    steps: int = 2400
    """Time steps a sequence."""
    chunk: int = 200
    """Steps of truncated back-propagation; the state is carried from chunk to chunk."""
    burn_in: int = 20
    """First steps of a sequence that do not count: the sensor's past is unknown there."""
    squared_error_share: float = 0.3
    """First part of the training with squared error instead of Gaussian likelihood: sigma learns last."""
    step_s: tuple[float, float] = (0.01, 0.1)
    """Range of time steps, drawn evenly in their logarithm: 100 to 10 Hz."""
    noise: tuple[float, float] = (0.0, 0.002)
    """Range of the relative white noise added to the resistance: up to that of a 10-bit divider."""
    seed: int = 0


def is_held_out(name: str) -> bool:
    """Whether a recording is kept from training: one whole speed, and the last specimen of each random motion."""
    return "_0.05_" in name or (name.startswith("random") and name.endswith("_s5"))


def train(
    recordings: Sequence[Recording],
    settings: TrainingSettings,
    progress: Callable[[int, float], None] = lambda epoch, loss: None,
) -> SensorModel:
    """Fit the gauge curve, train the network on recordings in which strain is mostly tensile, and score both.

    Every recording is first brought to the common curve by its own gain and offset, as the taring does at run time;
    the spread of those is kept in the model. The loss counts samples with strain >= 0 only, but bending passes
    through the input, so that the network knows a strip that comes back from it.

    Args:
        recordings: calibration recordings; `is_held_out` ones serve for scores alone.
        settings: the recipe.
        progress: called after each epoch with its number and mean loss.

    Raises:
        InputError: when there is nothing to train on.
    """
    bending = BendingCurve()
    gauge, own = fit_gauge([r for r in recordings if not is_held_out(r.name)], bending)
    _, own_of_all = fit_gauge(recordings, bending)
    own = own_of_all | own
    common = [Recording(r.name, r.t_s, r.strain, (r.change - own[r.name][1]) / own[r.name][0]) for r in recordings]
    training = [r for r in common if not is_held_out(r.name)]
    held_out = [r for r in common if is_held_out(r.name) and (r.strain >= 0).mean() > 0.3]
    if not training:
        raise InputError("no recording of stretching to train on")
    lstm = _train_lstm(training, gauge, settings, progress)
    model = _as_model(lstm, gauge, training, settings, sigma_scale=(1.0, 0.0), scores={})
    sigma_scale = _fit_sigma_scale([_run(model, r) for r in (*training, *held_out) if _in_working_range(r)])
    model = _as_model(lstm, gauge, training, settings, sigma_scale, scores={})
    scores = {r.name: _run(model, r).scores(model) for r in held_out}
    return _as_model(lstm, gauge, training, settings, sigma_scale, scores)


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """The network's output on one recording, where the tendon is stretched and the start has settled."""

    spread: NDArray[np.float64]
    error: NDArray[np.float64]
    static_error: NDArray[np.float64]
    sigma: NDArray[np.float64]

    def scores(self, model: SensorModel) -> dict[str, float]:
        z = self.error / (self.sigma * model.sigma_scale(self.spread))
        return {
            "rmse_strain": float(np.sqrt(np.mean(self.error**2))),
            "static_rmse_strain": float(np.sqrt(np.mean(self.static_error**2))),
            "coverage_68": float(np.mean(np.abs(z) < 1)),
            "coverage_95": float(np.mean(np.abs(z) < 1.96)),
        }


def _run(model: SensorModel, recording: Recording, step_s: float = 0.02) -> _Run:
    t_s = np.arange(recording.t_s[0], recording.t_s[-1], step_s)
    strain = np.interp(t_s, recording.t_s, recording.strain)
    change = np.interp(t_s, recording.t_s, recording.change)
    sensors, rate = StretchingSensors(model, 1), np.diff(change, prepend=change[0]) / step_s
    output = [sensors.step(change[k, None], rate[k, None], step_s) for k in range(len(t_s))]
    estimate, sigma = np.array(output)[..., 0].T
    running = StrainSpread(1)
    spread = np.array([running.step(estimate[k, None], step_s)[0] for k in range(len(t_s))])
    settled = (strain >= 0) & (t_s - t_s[0] > SETTLING_SAMPLES * 0.05)
    static = model.gauge.stretched_strain(change) - strain
    return _Run(spread[settled], (estimate - strain)[settled], static[settled], sigma[settled])


def _in_working_range(recording: Recording) -> bool:
    """Whether a recording's strains are those of a tensegrity: there sigma has to be right first."""
    strain = np.abs(recording.strain)
    return bool(np.quantile(strain, 0.95) < WORKING_STRAIN and (recording.strain >= 0).mean() > 0.3)


def _fit_sigma_scale(runs: Sequence[_Run]) -> tuple[float, float]:
    """Return (b, p) of sigma scale = b spread^p that make the errors of these runs most likely."""
    if not runs:
        return 1.0, 0.0
    z = np.concatenate([run.error / run.sigma for run in runs])
    log_spread = np.log(np.concatenate([run.spread for run in runs]))

    def negative_log_likelihood(parameters: NDArray[np.float64]) -> float:
        log_scale = parameters[0] + parameters[1] * log_spread
        return float(np.mean(0.5 * (z / np.exp(log_scale)) ** 2 + log_scale))

    log_b, p = minimize(negative_log_likelihood, [0.0, 0.0], method="Nelder-Mead").x
    return float(np.exp(log_b)), float(p)


class _Network(torch.nn.Module):
    def __init__(self, inputs: int, hidden: int) -> None:
        super().__init__()
        self.lstm = torch.nn.LSTM(inputs, hidden, batch_first=True)
        self.head = torch.nn.Linear(hidden, 2)
        with torch.no_grad():
            forget_bias = dict(self.lstm.named_parameters())["bias_ih_l0"][hidden : 2 * hidden]
            forget_bias += 1.0  # remember, to begin with
            self.head.weight *= 0.3  # start near the static curve

    def forward(self, x: torch.Tensor, state: Any) -> tuple[torch.Tensor, torch.Tensor, Any]:
        h, state = self.lstm(x, state)
        mean, log_variance = self.head(h).unbind(-1)
        return mean, log_variance.clamp(*LOG_VARIANCE_RANGE), state


def _train_lstm(
    recordings: Sequence[Recording],
    gauge: StaticGauge,
    settings: TrainingSettings,
    progress: Callable[[int, float], None],
) -> _Network:
    torch.manual_seed(settings.seed)
    rng = np.random.default_rng(settings.seed)
    network = _Network(features(np.zeros(1), np.zeros(1), 0.02).shape[-1], settings.hidden)
    optimizer = torch.optim.Adam(network.parameters(), lr=settings.learning_rate)
    chunks = range(0, settings.steps, settings.chunk)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, settings.learning_rate, total_steps=settings.epochs * len(chunks), pct_start=0.1
    )
    for epoch in range(settings.epochs):
        x, target, counted = _draw_sequences(recordings, gauge, settings, rng)
        state, losses = None, []
        for start in chunks:
            chunk = slice(start, start + settings.chunk)
            mean, log_variance, state = network(x[:, chunk], state)
            state = tuple(s.detach() for s in state)
            error = mean - target[:, chunk]
            if epoch < settings.squared_error_share * settings.epochs:
                loss = error**2
            else:
                loss = 0.5 * (error**2 * torch.exp(-log_variance) + log_variance)
            mean_loss = (loss * counted[:, chunk]).sum() / counted[:, chunk].sum().clamp(min=1)
            optimizer.zero_grad()
            mean_loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimizer.step()
            schedule.step()
            losses.append(mean_loss.item())
        progress(epoch + 1, float(np.mean(losses)))
    return network


def _draw_sequences(
    recordings: Sequence[Recording], gauge: StaticGauge, settings: TrainingSettings, rng: np.random.Generator
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return inputs (sequences, steps, 3), targets and which of them count, of random pieces."""
    count, steps = settings.sequences, settings.steps
    strain, change = np.empty((count, steps)), np.empty((count, steps))
    step_s = np.exp(rng.uniform(np.log(settings.step_s[0]), np.log(settings.step_s[1]), count))
    for k in range(count):
        r = recordings[int(rng.integers(len(recordings)))]
        step_s[k] = min(step_s[k], (r.t_s[-1] - r.t_s[0]) / steps)
        t_s = rng.uniform(r.t_s[0], r.t_s[-1] - step_s[k] * (steps - 1)) + step_s[k] * np.arange(steps)
        strain[k], change[k] = np.interp(t_s, r.t_s, r.strain), np.interp(t_s, r.t_s, r.change)
    noise = rng.uniform(*settings.noise, (count, 1)) * rng.standard_normal((count, steps))
    change = (1 + change) * (1 + noise) - 1
    rate = np.diff(change, axis=1, prepend=change[:, :1]) / step_s[:, None]
    x = features(change, rate, step_s[:, None])
    target = (strain - gauge.stretched_strain(change)) / STRAIN_SCALE
    counted = (strain >= 0) & (np.arange(steps) >= settings.burn_in)
    return tuple(torch.tensor(a, dtype=torch.float32) for a in (x, target, counted))  # type: ignore[return-value]


def _as_model(
    network: _Network,
    gauge: StaticGauge,
    recordings: Sequence[Recording],
    settings: TrainingSettings,
    sigma_scale: tuple[float, float],
    scores: dict[str, dict[str, float]],
) -> SensorModel:
    parameters = {name: p.detach().numpy().astype(np.float64) for name, p in network.named_parameters()}
    mode_change, mode_log_odds = fit_mode(recordings)
    tensors: dict[str, NDArray[np.float64]] = {
        "weight_ih": parameters["lstm.weight_ih_l0"],
        "weight_hh": parameters["lstm.weight_hh_l0"],
        "bias": parameters["lstm.bias_ih_l0"] + parameters["lstm.bias_hh_l0"],
        "head_weight": parameters["head.weight"],
        "head_bias": parameters["head.bias"],
        "strain_knots": gauge.strain_knots,
        "change_knots": gauge.change_knots,
        "mode_change": mode_change,
        "mode_log_odds": mode_log_odds,
    }
    t = np.arange(20) * 0.02
    tensors["golden_input"] = features(0.1 + 0.05 * np.sin(5 * t), 0.25 * np.cos(5 * t), 0.02)
    lstm = Lstm(*(tensors[name] for name in ("weight_ih", "weight_hh", "bias", "head_weight", "head_bias")))
    tensors["golden_output"] = run_lstm(lstm, tensors["golden_input"])
    change = np.concatenate([r.change for r in recordings])
    rate = np.concatenate([np.diff(r.change) / np.diff(r.t_s) for r in recordings])
    metadata = {
        "format": FORMAT,
        "units": {"change": "dR/R, fraction", "strain": "fraction of L0", "rate": "1/s", "step": "s"},
        "gates": "i f g o",
        "ranges": {
            "change": [float(change.min()), float(change.max())],
            "rate_per_s": float(np.quantile(np.abs(rate), 0.999)),
            "strain": [0.0, float(max(r.strain.max() for r in recordings))],
            "step_s": list(settings.step_s),
        },
        "spread": {"gain_sigma": gauge.gain_sigma, "offset_sigma": gauge.offset_sigma},
        "sigma_scale": list(sigma_scale),
        "recipe": asdict(settings),
        "trained_on": sorted(r.name for r in recordings),
        "held_out": scores,
    }
    return SensorModel(tensors, metadata)
