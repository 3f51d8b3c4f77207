"""The training's recipe, and what it finds; without torch, so that running and reporting need none."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..sensor.gauge import StaticGauge
from ..sensor.lstm import LstmWeights, Scaling
from ..sensor.rate_curve import RateCurve
from ..values.tables import AtLeastOne, NotNegative, Positive, Probability

CHECK_EVERY = 5
"""Epochs from one validation and checkpoint to the next."""


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """The training recipe, chosen on recordings that train or validate, never on those held out."""

    epochs: AtLeastOne = 200
    learning_rate: Positive = 0.01
    """Peak of a one-cycle schedule, Adam."""
    weight_decay_s: NotNegative = 45.0
    """AdamW's decoupled weight decay times the seconds trained on: a prior on what the network adds to the curve, as
    strong however long the recordings are, so that a few minutes of one strip do not overfit. On the shipped recordings
    (76 minutes) 45 to 450 give the same validation loss, more gives a worse one."""
    hidden: AtLeastOne = 16
    sequences: AtLeastOne = 32
    """Random sequences an epoch, each with its own time step."""
    steps: AtLeastOne = 2400
    """Time steps a sequence."""
    chunk: AtLeastOne = 200
    """Steps of truncated back-propagation; the state is carried from chunk to chunk."""
    burn_in: int = 20
    """First steps of a sequence that do not count: the sensor's past is unknown there."""
    squared_error_share: Probability = 0.3
    """First part of the training with squared error instead of Gaussian likelihood: sigma learns last."""
    patience: AtLeastOne = 100
    """Epochs without a better validation loss after which the training stops."""
    relative_step: tuple[float, float] = (0.2, 2.0)
    """Range of time steps in units of the recordings' own, drawn evenly in their logarithm: of 20 Hz, 100 to 10 Hz."""
    noise: tuple[float, float] = (0.0, 0.002)
    """Range of the relative white noise added to the resistance: up to that of a 10-bit divider."""
    unified: bool = False
    """One signed network for bending and stretching, instead of the paper's eq. (3)."""
    seed: int = 0


class Checkpoint(Protocol):
    """Where an unfinished training is kept."""

    def load(self) -> bytes | None:
        """Return what was saved last."""
        ...

    def save(self, state: bytes) -> None:
        """Keep a state in place of the last."""
        ...


class NoCheckpoint:
    """Keeps nothing."""

    def load(self) -> bytes | None:
        """Return nothing."""
        return None

    def save(self, state: bytes) -> None:
        """Do nothing."""


@dataclass(slots=True)
class History:
    """The losses of a training; validation is checked every `CHECK_EVERY` epochs."""

    training_loss: list[float] = field(default_factory=list)
    """Mean loss of each epoch."""
    validation_epoch: list[int] = field(default_factory=list)
    """Epochs after which the validation was checked."""
    validation_loss: list[float] = field(default_factory=list)
    """Its loss there."""
    best_epoch: int = 0
    """The epoch whose weights were kept."""
    best_loss: float = float("inf")
    """Its validation loss."""
    likelihood_from: int = 0
    """The epoch from which the loss is the Gaussian likelihood's."""


@dataclass(frozen=True, slots=True, eq=False)
class Trained:
    """What a training found."""

    weights: LstmWeights
    """The network's."""
    curve: RateCurve
    """What it corrects."""
    gain_and_offset: Mapping[str, NDArray[np.float64]]
    """(2,) gain and offset of each strip trained on."""
    scaling: Scaling
    """Of the inputs."""
    step_s: tuple[float, float]
    """Range of time steps trained on."""
    history: History
    """Of the losses."""

    @property
    def gauge(self) -> StaticGauge:
        """The static curve, with the spread of gain and offset over strips."""
        return self.curve.gauge
