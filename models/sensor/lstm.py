"""The stretching sensor at run time: the paper's LSTM, eqs. (10)-(15), with a Gaussian head, in numpy.

The network corrects a `RateCurve`: strain = curve(dR/R, running means) + STRAIN_SCALE * W_y h_t, and its second output
is the log variance of the strain. Its input X_t consists of dR/R, the rate of dR/R per second, the log of the time
step, so that one network is valid from 10 to 100 Hz, and the differences between dR/R and its running means over
`MEMORY_S`. The running means are needed because rubber relaxes for longer than back-propagation reaches.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from ..values.tables import Positive
from ..values.time_series import low_pass_weight, low_passed

STRAIN_SCALE = 0.05
"""Unit of strain in which the network's outputs are given."""
LOG_VARIANCE_RANGE = (-10.0, 4.0)
"""Range to which the second output, the log variance, is clipped."""
MEMORY_S = (2.0, 10.0, 50.0)
"""Time constants of the running means."""
CURVE_MEMORIES = 2
"""Number of running means, from the first on, that are inputs of the rate curve. A recording of some minutes is too
short, compared with the last time constant, to fit its effect."""


@dataclass(frozen=True, slots=True)
class Scaling:
    """Scales that bring the network's inputs to a magnitude of about 1."""

    change_middle: Annotated[float, Interval(ge=-10, le=10)] = 0.15
    """Value that is subtracted from dR/R before it is divided by `change`."""
    change: Positive = 0.3
    """Divisor of dR/R and of its differences from its running means."""
    rate_per_s: Positive = 0.3
    """Divisor of the rate of dR/R."""
    step_s: Positive = 0.03
    """Divisor of the time step before its natural logarithm is taken."""


def features(
    change: NDArray[np.float64],
    rate_per_s: NDArray[np.float64],
    step_s: float | NDArray[np.float64],
    means: NDArray[np.float64],
    scaling: Scaling,
) -> NDArray[np.float64]:
    """Return the network's input X_t, (..., 3 + memories), from dR/R, its rate, the time step and running means."""
    x = np.empty((*change.shape, 3 + means.shape[-1]))
    x[..., 0] = (change - scaling.change_middle) / scaling.change
    x[..., 1] = rate_per_s / scaling.rate_per_s
    x[..., 2] = np.log(np.asarray(step_s) / scaling.step_s)
    x[..., 3:] = (change[..., None] - means) / scaling.change
    return x


def running_means(
    change: NDArray[np.float64],
    step_s: NDArray[np.float64],
    memory_s: NDArray[np.float64],
    start: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return (samples, sensors, memories) running means of dR/R: m += (y - m) (1 - exp(-dt / tau)).

    Args:
        change: (samples, sensors) dR/R.
        step_s: (samples, sensors), or (samples, 1) for all, the time before each sample.
        memory_s: (memories,) tau.
        start: (sensors, memories) the means before the first sample; None for its dR/R.
    """
    start = np.repeat(change[0][:, None], len(memory_s), axis=1) if start is None else start
    return low_passed(change[..., None], low_pass_weight(step_s[..., None], memory_s), start)


@dataclass(frozen=True, slots=True, eq=False)
class LstmState:
    """The state of the network for each sensor."""

    h: NDArray[np.float64]
    """(sensors, hidden) short-term memory, eq. (15)."""
    c: NDArray[np.float64]
    """(sensors, hidden) long-term memory, eq. (13)."""


@dataclass(frozen=True, slots=True, eq=False)
class LstmWeights:
    """The weights of `Lstm`, gates in the order i, f, g, o of torch's parameters."""

    weight_ih: NDArray[np.float64]
    """(4 hidden, features) weights of the input X_t."""
    weight_hh: NDArray[np.float64]
    """(4 hidden, hidden) weights of the short-term memory."""
    bias: NDArray[np.float64]
    """(4 hidden,) biases of the gates."""
    head_weight: NDArray[np.float64]
    """(2, hidden) weights of the linear head."""
    head_bias: NDArray[np.float64]
    """(2,) biases of the linear head."""


class Lstm:
    """One LSTM layer and a linear head; one step computes all sensors.

    Because sigma(z) = (1 + tanh(z / 2)) / 2, the weights of the three sigmoid gates are halved once, and then all four
    gates need only one tanh. What inputs contribute to the gates is computed for all steps at once.
    """

    def __init__(self, weights: LstmWeights) -> None:
        self.hidden = weights.weight_hh.shape[1]
        half = np.repeat([0.5, 0.5, 1.0, 0.5], self.hidden)
        self._input_weight = weights.weight_ih.T * half
        self._hidden_weight = weights.weight_hh.T * half
        self._bias = weights.bias * half
        self._head_weight = weights.head_weight.T
        self._head_bias = weights.head_bias

    def initial_state(self, sensors: int) -> LstmState:
        """Return the state before the first reading of each sensor."""
        return LstmState(np.zeros((sensors, self.hidden)), np.zeros((sensors, self.hidden)))

    def run(self, x: NDArray[np.float64], state: LstmState) -> tuple[NDArray[np.float64], LstmState]:
        """Return (steps, sensors, 2) outputs and the state after them, from (steps, sensors, features) inputs."""
        n = self.hidden
        of_input = (x.reshape(-1, x.shape[-1]) @ self._input_weight + self._bias).reshape(*x.shape[:-1], 4 * n)
        hidden = np.empty((*x.shape[:-1], n))
        h, c = state.h, state.c
        for k, gates_of_input in enumerate(of_input):
            gates = np.tanh(gates_of_input + h @ self._hidden_weight)
            opened = 0.5 + 0.5 * gates
            i, f, o = opened[:, :n], opened[:, n : 2 * n], opened[:, 3 * n :]
            c = f * c + i * gates[:, 2 * n : 3 * n]  # eqs. (10)-(13)
            hidden[k] = h = o * np.tanh(c)  # eqs. (14), (15)
        return hidden @ self._head_weight + self._head_bias, LstmState(h, c)


def run_lstm(lstm: Lstm, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (steps, 2) outputs for one sensor's (steps, features) inputs, from the initial state."""
    return lstm.run(x[:, None], lstm.initial_state(1))[0][:, 0]
