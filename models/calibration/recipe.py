"""The settings and the result of a training, without torch, so that a run and a report do not need it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..sensor.gauge import StaticGauge
from ..sensor.lstm import LstmWeights, Scaling
from ..sensor.rate_curve import RateCurve
from ..values.errors import InputError
from ..values.tables import AtLeastOne, NotNegative, Positive, Probability, ZeroOrMore

CHECK_EVERY = 5
"""Number of epochs from one validation and checkpoint to the next."""


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """The settings of the training, chosen on the training and validation recordings, never on those held out."""

    epochs: AtLeastOne = 200
    learning_rate: Positive = 0.01
    """Largest learning rate of a one-cycle schedule with AdamW."""
    weight_decay_s: NotNegative = 45.0
    """Decoupled weight decay of AdamW times the duration of the training recordings. It is a prior on the correction of
    the curve by the network, whose strength does not depend on the duration, so that a few minutes of one strip do not
    overfit. On the shipped recordings (76 minutes) 45 to 450 give the same validation loss, and more gives a worse
    one."""
    hidden: AtLeastOne = 16
    sequences: AtLeastOne = 32
    """Random sequences per epoch, each with its own time step."""
    steps: AtLeastOne = 2400
    """Time steps per sequence."""
    chunk: AtLeastOne = 200
    """Steps of truncated back-propagation; the state is carried from chunk to chunk."""
    burn_in: ZeroOrMore = 20
    """First steps of a sequence that are not in the loss, because the sensor's past is unknown there."""
    squared_error_share: Probability = 0.3
    """First share of the training in which the loss is the squared error instead of the Gaussian likelihood, so that
    sigma is learned last."""
    patience: AtLeastOne = 100
    """Epochs without a better validation loss after which the training stops."""
    relative_step: tuple[Positive, Positive] = (0.2, 2.0)
    """Range of time steps relative to that of the recordings, drawn uniformly in their logarithm: for recordings of
    20 Hz this is 100 to 10 Hz. For others it is widened, so that it contains these rates of frames."""
    noise: tuple[NotNegative, NotNegative] = (0.0, 0.002)
    """Range of the standard deviation of the relative white noise that is added to the resistance: up to that of a
    10-bit divider."""
    unified: bool = False
    """One signed network for bending and stretching, instead of the paper's eq. (3)."""
    seed: ZeroOrMore = 0

    def __post_init__(self) -> None:
        for name in ("relative_step", "noise"):
            ends = list(getattr(self, name))
            if len(ends) != 2 or ends[1] < ends[0]:
                raise InputError(f"{name}: expected [least, most], got {ends}")
        if self.burn_in >= self.steps:
            raise InputError(f"burn_in: expected less than steps = {self.steps}, got {self.burn_in}")


class Checkpoint(Protocol):
    """The storage of an unfinished training."""

    def load(self) -> bytes | None:
        """Return the state that was saved last; None when there is none."""
        ...

    def save(self, state: bytes) -> None:
        """Store a state in place of the last one."""
        ...


class NoCheckpoint:
    """A checkpoint that stores nothing."""

    def load(self) -> bytes | None:
        """Return None."""
        return None

    def save(self, state: bytes) -> None:
        """Do nothing."""


@dataclass(slots=True)
class History:
    """The losses of a training; validation is checked every `CHECK_EVERY` epochs."""

    training_loss: list[float] = field(default_factory=list)
    """Mean loss of each epoch."""
    validation_epoch: list[int] = field(default_factory=list)
    """Epochs after which the validation loss was computed."""
    validation_loss: list[float] = field(default_factory=list)
    """Validation loss after each of these epochs."""
    best_epoch: int = 0
    """The epoch after which the validation loss was least; its weights are kept."""
    best_loss: float = float("inf")
    """Validation loss after the best epoch."""
    likelihood_from: int = 0
    """The epoch from which on the loss is the negative log of the Gaussian likelihood."""


@dataclass(frozen=True, slots=True, eq=False)
class Trained:
    """The result of a training."""

    weights: LstmWeights
    """Weights of the network."""
    curve: RateCurve
    """The curve that the network corrects."""
    gain_and_offset: Mapping[str, NDArray[np.float64]]
    """(2,) gain and offset of each strip in the training, by the name of its recording."""
    scaling: Scaling
    """Scales of the network's inputs."""
    step_s: tuple[float, float]
    """Range of time steps in the training."""
    history: History
    """Losses of the training."""

    @property
    def gauge(self) -> StaticGauge:
        """The static curve, with the spread of gain and offset over strips."""
        return self.curve.gauge
