"""Training of the stretching network, eqs. (10)-(15), on calibration recordings."""

import hashlib
import io
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..sensor.bending import BendingCurve
from ..sensor.lstm import CURVE_MEMORIES, MEMORY_S, STRAIN_SCALE, Scaling
from ..values.time_series import median_step_s
from .gauge_fit import fit_gauge
from .rate_curve_fit import fit_rate_curve
from .recipe import CHECK_EVERY, Checkpoint, History, NoCheckpoint, Trained, TrainingSettings
from .recordings import Recording, Split, correlated_samples, on_common_curve
from .torch_network import (
    StretchingModule,
    curve_strain,
    lstm_weights,
    network_input,
    sample_loss,
    scaled_gaussian_loss,
)

CHECKPOINT_VERSION = 3
"""Version of the names in a checkpoint; a checkpoint of another version is not used."""
WARM_UP = 0.1
"""Share of the updates in which the learning rate rises, of the one-cycle schedule."""
FRAME_STEP_S = (0.01, 0.1)
"""Time steps at which every model is trained: those of frames at 100 to 10 Hz; of a recording in which so many steps
have no room, at shorter ones alone."""
FEWEST_UPDATES = 20
"""Shortest one-cycle schedule: with half as many its rise has no length, and torch divides by it."""


def train(
    split: Split,
    bending: BendingCurve,
    settings: TrainingSettings,
    progress: Callable[[int, float], None] = lambda epoch, loss: None,
    checkpoint: Checkpoint | None = None,
) -> Trained:
    """Fit the curves, and then the network, to recordings in which strain is mostly tensile.

    The gain and offset of each strip are unknown; they are learned together with the network, with their spread over
    strips as prior. The loss counts only samples with strain >= 0. Bent samples are in the input all the same, so that
    the network learns the state of a strip after bending. For a unified network the loss counts all samples.

    Args:
        split: the recordings for training and validation.
        bending: the curve of bent strips.
        settings: the settings of the training.
        progress: called after each epoch with its number and mean loss.
        checkpoint: the storage of the unfinished training, from which it continues. A state of other data or settings,
            or what is none, is not used.

    Raises:
        InputError: when there is nothing to train on.
    """
    with _torch_in_one_thread():
        training = _Training(split, bending, settings)
        training.run(progress, checkpoint or NoCheckpoint())
        return training.result()


@contextmanager
def _torch_in_one_thread() -> Iterator[None]:
    """Run torch in one thread, so that sums have the same order on any machine; a small network is not slower."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@dataclass(frozen=True, slots=True, eq=False)
class _Batch:
    """Pieces of recordings, resampled to constant time steps."""

    strip: torch.Tensor
    """(sequences,) index of the strip."""
    change: torch.Tensor
    """(sequences, steps) dR/R with noise."""
    means: torch.Tensor
    """(sequences, steps, memories) running means of dR/R, without noise."""
    step_s: torch.Tensor
    """(sequences, 1)"""
    strain: torch.Tensor
    """(sequences, steps)"""
    counted: torch.Tensor
    """(sequences, steps) 1 for the samples in the loss, 0 for others."""


class _Training:
    """The state of a training, which is updated in each epoch."""

    def __init__(self, split: Split, bending: BendingCurve, settings: TrainingSettings) -> None:
        self._settings = settings
        self._gauge, training_gains = fit_gauge(split.training, bending)
        common = on_common_curve(split.training, training_gains)
        self._curve = fit_rate_curve(common, self._gauge, np.array(MEMORY_S[:CURVE_MEMORIES]), settings.unified)
        _, validation_gains = fit_gauge([*split.training, *split.validation], bending)
        self._recordings = split.training
        self._spread = np.array([self._gauge.gain_sigma, self._gauge.offset_sigma])
        self._names = [r.name for r in split.training]
        gains = validation_gains | training_gains
        units = np.array([(gains[r.name] - [1, 0]) / self._spread for r in split.training])
        validation_units = np.array([(gains[r.name] - [1, 0]) / self._spread for r in split.validation])
        self._scaling = _scaling(split.training)
        self._step_s = _step_range(split.training, settings.relative_step)
        recordings = (*split.training, *split.validation)
        self._means = {(r.name, len(r.t_s)): r.running_means(np.array(MEMORY_S)) for r in recordings}
        self._prepare(split, units, validation_units)

    def _prepare(self, split: Split, units: NDArray[np.float64], validation_units: NDArray[np.float64]) -> None:
        """Set up the network and its optimiser.

        Args:
            split: the recordings for training and validation.
            units: (strips, 2) gain - 1 and offset of the training recordings, in units of their spread.
            validation_units: (strips, 2) the same for the validation recordings.
        """
        settings = self._settings
        torch.manual_seed(settings.seed)
        self._rng = np.random.default_rng(settings.seed)
        self._network = StretchingModule(3 + len(MEMORY_S), settings.hidden, units)
        self._validation_gains = torch.tensor(validation_units, dtype=torch.float32, requires_grad=True)
        names = {name: k for k, name in enumerate(self._names)}
        self._trained_strips = [(k, names[r.name]) for k, r in enumerate(split.validation) if r.name in names]
        self._validation_optimizer = torch.optim.Adam([self._validation_gains], lr=0.1)
        shared = [p for p in self._network.parameters() if p is not self._network.free_gains]
        trained_s = sum(r.duration_s for r in split.training)
        groups: list[dict[str, Any]] = [
            {"params": shared, "weight_decay": settings.weight_decay_s / trained_s},
            {"params": [self._network.free_gains], "weight_decay": 0.0},
        ]
        self._optimizer = torch.optim.AdamW(groups, lr=settings.learning_rate)
        self._chunks = [slice(k, k + settings.chunk) for k in range(0, settings.steps, settings.chunk)]
        updates = max(settings.epochs * len(self._chunks), FEWEST_UPDATES)
        self._schedule = torch.optim.lr_scheduler.OneCycleLR(
            self._optimizer, settings.learning_rate, total_steps=updates, pct_start=WARM_UP
        )
        self.history = History(likelihood_from=int(settings.squared_error_share * settings.epochs))
        self._best = self._copy()
        self._validation = self._draw(split.validation, np.random.default_rng(settings.seed + 1))
        independent = sum(len(r.t_s) / correlated_samples(r.t_s) for r in split.training)
        self._prior_weight = 0.5 / independent
        self._fingerprint = _fingerprint(split, settings)

    def run(self, progress: Callable[[int, float], None], checkpoint: Checkpoint) -> None:
        self._resume(checkpoint.load())
        while len(self.history.training_loss) < self._settings.epochs and not self._stalled():
            self.history.training_loss.append(self._epoch(len(self.history.training_loss)))
            epoch = len(self.history.training_loss)
            progress(epoch, self.history.training_loss[-1])
            if epoch % CHECK_EVERY == 0 or epoch == self._settings.epochs:
                self._validate(epoch)
                checkpoint.save(self._state())

    def _stalled(self) -> bool:
        history = self.history
        return bool(history.best_epoch) and len(history.training_loss) - history.best_epoch >= self._settings.patience

    def _epoch(self, epoch: int) -> float:
        batch = self._draw(self._recordings, self._rng)
        state = None
        losses = []
        likelihood = epoch >= self.history.likelihood_from
        for chunk in self._chunks:
            x, curve = self._inputs(batch, self._network.gains, chunk)
            mean, log_variance, state = self._network(x, state)
            state = tuple(s.detach() for s in state)
            error = mean + (curve - batch.strain[:, chunk]) / STRAIN_SCALE
            loss = sample_loss(error, log_variance, batch.counted[:, chunk], likelihood)
            prior = self._prior_weight * (self._network.gains**2).sum() if likelihood else 0.0
            self._optimizer.zero_grad()
            (loss + prior).backward()  # type: ignore[no-untyped-call]
            if not likelihood:  # the squared error has no scale that the prior could be compared with
                self._network.free_gains.grad = None
            torch.nn.utils.clip_grad_norm_(self._network.parameters(), 1.0)
            self._optimizer.step()
            self._schedule.step()
            losses.append(loss.item())
        return float(np.mean(losses))

    def _validate(self, epoch: int) -> None:
        """Compute the validation loss, and fit the gain and offset of the validation strips by one step."""
        likelihood = epoch > self.history.likelihood_from
        history = self.history
        gains = self._validation_gains
        with torch.no_grad():  # gain and offset of a strip that is in the training, too, are known from there
            for k, strip in self._trained_strips:
                gains[k] = self._network.gains[strip]
        x, curve = self._inputs(self._validation, gains, slice(0, self._settings.steps))
        mean, log_variance, _ = self._network(x, None)
        error = mean + (curve - self._validation.strain) / STRAIN_SCALE
        counted = self._validation.counted
        loss = (
            scaled_gaussian_loss(error, log_variance, counted)
            if likelihood
            else sample_loss(error, log_variance, counted, False)
        )
        if likelihood:
            self._validation_optimizer.zero_grad()
            (loss + self._prior_weight * (gains**2).sum()).backward()  # type: ignore[no-untyped-call]
            self._validation_optimizer.step()
        history.validation_epoch.append(epoch)
        history.validation_loss.append(loss.item())
        if likelihood and loss.item() < history.best_loss:
            history.best_epoch = epoch
            history.best_loss = loss.item()
            self._best = self._copy()

    def _copy(self) -> dict[str, torch.Tensor]:
        return {name: value.detach().clone() for name, value in self._network.state_dict().items()}

    def _draw(self, recordings: Sequence[Recording], rng: np.random.Generator) -> _Batch:
        """Return random pieces of recordings, each with its own time step and noise."""
        count = self._settings.sequences
        steps = self._settings.steps
        strain = np.empty((count, steps))
        change = np.empty((count, steps))
        means = np.empty((count, steps, len(MEMORY_S)))
        low, high = self._step_s
        step_s = np.exp(rng.uniform(np.log(low), np.log(high), count))
        strip = np.empty(count, dtype=np.int64)
        counts = np.zeros((count, steps), dtype=np.bool_)
        for k in range(count):
            strip[k] = rng.integers(len(recordings))
            r = recordings[strip[k]]
            step_s[k] = min(step_s[k], r.duration_s / steps)
            last_start_s = r.t_s[-1] - step_s[k] * (steps - 1)
            first_start_s = min(max(r.t_s[0], r.scored_from_s), last_start_s)  # so that most samples are counted
            t_s = rng.uniform(first_start_s, last_start_s) + step_s[k] * np.arange(steps)
            strain[k] = np.interp(t_s, r.t_s, r.strain)
            change[k] = np.interp(t_s, r.t_s, r.change)
            means[k] = np.stack([np.interp(t_s, r.t_s, column) for column in self._means[r.name, len(r.t_s)].T], axis=1)
            counts[k] = t_s > r.scored_from_s
        noise = rng.uniform(*self._settings.noise, (count, 1)) * rng.standard_normal((count, steps))
        counts &= np.arange(steps) >= self._settings.burn_in
        if not self._settings.unified:
            counts &= strain >= 0
        noisy = (1 + change) * (1 + noise) - 1
        return _Batch(
            strip=torch.tensor(strip),
            change=torch.tensor(noisy, dtype=torch.float32),
            means=torch.tensor(means, dtype=torch.float32),
            step_s=torch.tensor(step_s[:, None], dtype=torch.float32),
            strain=torch.tensor(strain, dtype=torch.float32),
            counted=torch.tensor(counts, dtype=torch.float32),
        )

    def _inputs(self, batch: _Batch, units: torch.Tensor, chunk: slice) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the network's input (sequences, chunk, features), and the strain of the curve that it corrects.

        Args:
            batch: the pieces of recordings.
            units: (strips, 2) gain - 1 and offset in units of their spread.
            chunk: the time steps.
        """
        gains = units[batch.strip] * torch.tensor(self._spread, dtype=torch.float32)
        common = (batch.change[:, max(chunk.start - 1, 0) : chunk.stop] - gains[:, 1:]) / (1 + gains[:, :1])
        before = common[:, :1]
        common = common[:, 1:] if chunk.start else common
        rate = torch.diff(common, dim=1, prepend=before) / batch.step_s
        means = (batch.means[:, chunk] - gains[:, None, 1:]) / (1 + gains[:, None, :1])
        x = network_input(common, rate, batch.step_s, means, self._scaling)
        return x, curve_strain(self._curve, common, means[..., :CURVE_MEMORIES])

    def _state(self) -> bytes:
        buffer = io.BytesIO()
        torch.save(
            {
                "fingerprint": self._fingerprint,
                "network": self._network.state_dict(),
                "optimizer": self._optimizer.state_dict(),
                "schedule": self._schedule.state_dict(),
                "validation_gains": self._validation_gains.detach(),
                "tare": self._validation_optimizer.state_dict(),
                "best": self._best,
                "history": json.dumps(asdict(self.history)),
                "rng": json.dumps(self._rng.bit_generator.state),
            },
            buffer,
        )
        return buffer.getvalue()

    def _resume(self, saved: bytes | None) -> None:
        if saved is None:
            return
        try:
            state = torch.load(io.BytesIO(saved), weights_only=True)
        except Exception:  # of many kinds, for another file, or half of one
            return
        if not isinstance(state, dict) or state.get("fingerprint") != self._fingerprint:
            return
        self._network.load_state_dict(state["network"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._schedule.load_state_dict(state["schedule"])
        self._validation_gains.data.copy_(state["validation_gains"])
        self._validation_optimizer.load_state_dict(state["tare"])
        self._best = state["best"]
        self.history = History(**json.loads(state["history"]))
        self._rng.bit_generator.state = json.loads(state["rng"])

    def result(self) -> Trained:
        """Return the network with the least validation loss, as numpy arrays."""
        best = {name: value.numpy().astype(np.float64) for name, value in self._best.items()}
        units = best["free_gains"] - best["free_gains"].mean(axis=0) + best["mean_gains"]
        gains = np.array([1.0, 0.0]) + units * self._spread
        return Trained(
            weights=lstm_weights(best),
            curve=self._curve,
            gain_and_offset=dict(zip(self._names, gains, strict=True)),
            scaling=self._scaling,
            step_s=self._step_s,
            history=self.history,
        )


def _scaling(recordings: Sequence[Recording]) -> Scaling:
    """Return scales of the inputs from the recordings, rounded to two digits."""
    change = np.concatenate([r.change for r in recordings])
    rate = np.concatenate([np.diff(r.change) / np.diff(r.t_s) for r in recordings])
    values = (np.median(change), np.std(change), np.sqrt(np.mean(rate**2)))
    return Scaling(*(float(f"{value:.2g}") for value in values))


def _step_range(recordings: Sequence[Recording], relative: tuple[float, float]) -> tuple[float, float]:
    """Return the range of time steps, given relative to that of the recordings, rounded to two digits.

    It contains `FRAME_STEP_S`, at whatever rate the rig reads its strips.
    """
    step_s = float(np.median([median_step_s(r.t_s) for r in recordings]))
    shortest_s, longest_s = (float(f"{ratio * step_s:.2g}") for ratio in relative)
    return min(shortest_s, FRAME_STEP_S[0]), max(longest_s, FRAME_STEP_S[1])


def _fingerprint(split: Split, settings: TrainingSettings) -> str:
    """Return a hash of everything that a checkpoint depends on."""
    versions = [CHECKPOINT_VERSION, torch.__version__]
    digest = hashlib.sha256(json.dumps([asdict(settings), *versions], sort_keys=True).encode())
    for recordings in (split.training, split.validation):
        for r in recordings:
            digest.update(f"|{r.name}|{r.scored_from_s}".encode())
            for values in (r.t_s, r.strain, r.change):
                digest.update(values.tobytes())
    return digest.hexdigest()
