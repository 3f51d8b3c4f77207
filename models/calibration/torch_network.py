"""The network and the rate curve in torch, for their gradients in training.

At run time `sensor.lstm` and `sensor.rate_curve` are used; tests check that the two versions of each equation agree.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..sensor.gauge import StaticGauge
from ..sensor.lstm import LOG_VARIANCE_RANGE, LstmWeights, Scaling
from ..sensor.rate_curve import RateCurve, product_indices


class StretchingModule(torch.nn.Module):
    """The LSTM with its head, and the gain and offset of each strip, in units of their spread."""

    def __init__(self, inputs: int, hidden: int, gains: NDArray[np.float64]) -> None:
        super().__init__()
        self.lstm = torch.nn.LSTM(inputs, hidden, batch_first=True)
        self.head = torch.nn.Linear(hidden, 2)
        self.register_buffer("mean_gains", torch.tensor(gains.mean(axis=0), dtype=torch.float32))
        self.free_gains = torch.nn.Parameter(torch.tensor(gains, dtype=torch.float32))
        with torch.no_grad():
            forget_bias = dict(self.lstm.named_parameters())["bias_ih_l0"][hidden : 2 * hidden]
            forget_bias += 1.0  # so that the network keeps its memory at the start of the training
            self.head.weight *= torch.tensor([[0.0], [0.3]])  # so that the training starts at the curve
            self.head.bias[0] = 0.0

    @property
    def gains(self) -> torch.Tensor:
        """(strips, 2) gain and offset; their mean is fixed, because a gain that all strips share is in the curve."""
        return self.free_gains - self.free_gains.mean(dim=0) + self.get_buffer("mean_gains")

    def forward(self, x: torch.Tensor, state: Any) -> tuple[torch.Tensor, torch.Tensor, Any]:
        """Return mean and log variance, each (sequences, steps), and the state after (sequences, steps, features) x."""
        h, state = self.lstm(x, state)
        mean, log_variance = self.head(h).unbind(-1)
        return mean, log_variance.clamp(*LOG_VARIANCE_RANGE), state


def lstm_weights(parameters: Mapping[str, NDArray[np.float64]]) -> LstmWeights:
    """Return the weights of `sensor.lstm` from the parameters of a torch module with an `lstm` and a linear `head`."""
    return LstmWeights(
        weight_ih=parameters["lstm.weight_ih_l0"],
        weight_hh=parameters["lstm.weight_hh_l0"],
        bias=parameters["lstm.bias_ih_l0"] + parameters["lstm.bias_hh_l0"],
        head_weight=parameters["head.weight"],
        head_bias=parameters["head.bias"],
    )


def network_input(
    change: torch.Tensor, rate_per_s: torch.Tensor, step_s: torch.Tensor, means: torch.Tensor, scaling: Scaling
) -> torch.Tensor:
    """Return `sensor.lstm.features` in torch, (sequences, steps, features).

    Args:
        change: (sequences, steps) dR/R on the common curve.
        rate_per_s: (sequences, steps) rate of it.
        step_s: (sequences, 1) time step.
        means: (sequences, steps, memories) running means of dR/R.
        scaling: of the inputs.
    """
    step = torch.log(step_s / scaling.step_s).expand_as(change)
    now = torch.stack(
        [(change - scaling.change_middle) / scaling.change, rate_per_s / scaling.rate_per_s, step], dim=-1
    )
    return torch.cat([now, (change[..., None] - means) / scaling.change], dim=-1)


def curve_strain(curve: RateCurve, common: torch.Tensor, means: torch.Tensor) -> torch.Tensor:
    """Return the strain of `RateCurve.estimate`, computed in torch."""
    scale = torch.tensor(curve.scale, dtype=torch.float32)
    low = torch.tensor(curve.range[0], dtype=torch.float32)
    high = torch.tensor(curve.range[1], dtype=torch.float32)
    coefficients = torch.tensor(curve.coefficients, dtype=torch.float32)
    inputs = torch.cat([common[..., None], common[..., None] - means], dim=-1)
    clipped = torch.minimum(torch.maximum(inputs, low), high)
    factors = torch.cat([torch.ones_like(clipped[..., :1]), clipped / scale], dim=-1)
    first, second, third = product_indices(clipped.shape[-1]).T
    products = factors[..., first] * factors[..., second] * factors[..., third]
    static = _static_strain(curve.gauge, clipped[..., 0])
    strain = products @ coefficients[:-1] + coefficients[-1] * static
    return strain + _static_strain(curve.gauge, common) - static


def _static_strain(gauge: StaticGauge, common: torch.Tensor) -> torch.Tensor:
    """Return `StaticGauge.stretched_strain`, computed in torch as a sum of ramps."""
    slopes = np.diff(gauge.strain_knots) / np.diff(gauge.change_knots)
    strain = float(slopes[0]) * common
    for knot, bend in zip(gauge.change_knots[1:-1].tolist(), np.diff(slopes).tolist(), strict=True):
        strain = strain + bend * torch.relu(common - knot)
    return strain.clamp(max=gauge.most_strain)


def sample_loss(
    error: torch.Tensor, log_variance: torch.Tensor, counted: torch.Tensor, likelihood: bool
) -> torch.Tensor:
    """Return the mean over the counted samples of -log likelihood, or else of the squared error."""
    loss = 0.5 * (error**2 * torch.exp(-log_variance) + log_variance) if likelihood else error**2
    return (loss * counted).sum() / counted.sum().clamp(min=1)


def scaled_gaussian_loss(error: torch.Tensor, log_variance: torch.Tensor, counted: torch.Tensor) -> torch.Tensor:
    """Return the Gaussian loss with the factor of sigma that minimises it, because sigma is scaled after training."""
    count = counted.sum().clamp(min=1)
    mean_square = (error**2 * torch.exp(-log_variance) * counted).sum() / count
    return 0.5 * ((log_variance * counted).sum() / count + torch.log(mean_square + 1e-12) + 1)
