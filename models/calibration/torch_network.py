"""The network and the rate curve in torch, to differentiate them; `sensor.lstm` and `sensor.rate_curve` run them.

Tests hold the two versions of each equation together.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..sensor.gauge import StaticGauge
from ..sensor.lstm import LOG_VARIANCE_RANGE
from ..sensor.rate_curve import RateCurve, product_indices


class StretchingModule(torch.nn.Module):
    """The LSTM with its head, and the gain and offset of each strip, in units of their spread."""

    def __init__(self, inputs: int, hidden: int, own: NDArray[np.float64]) -> None:
        super().__init__()
        self.lstm = torch.nn.LSTM(inputs, hidden, batch_first=True)
        self.head = torch.nn.Linear(hidden, 2)
        self.register_buffer("mean_own", torch.tensor(own.mean(axis=0), dtype=torch.float32))
        self.own_away = torch.nn.Parameter(torch.tensor(own, dtype=torch.float32))
        with torch.no_grad():
            forget_bias = dict(self.lstm.named_parameters())["bias_ih_l0"][hidden : 2 * hidden]
            forget_bias += 1.0  # remember, to begin with
            self.head.weight *= torch.tensor([[0.0], [0.3]])  # start on the curve
            self.head.bias[0] = 0.0

    @property
    def own(self) -> torch.Tensor:
        """(strips, 2) with the mean that they began with: a gain common to all strips is the curve's."""
        return self.own_away - self.own_away.mean(dim=0) + self.get_buffer("mean_own")

    def forward(self, x: torch.Tensor, state: Any) -> tuple[torch.Tensor, torch.Tensor, Any]:
        """Return mean and log variance, (sequences, steps) each, and the state after (sequences, steps, features)."""
        h, state = self.lstm(x, state)
        mean, log_variance = self.head(h).unbind(-1)
        return mean, log_variance.clamp(*LOG_VARIANCE_RANGE), state


def curve_strain(curve: RateCurve, common: torch.Tensor, means: torch.Tensor) -> torch.Tensor:
    """Return `RateCurve.strain` in torch, which can differentiate it."""
    scale, low, high, coefficients = (
        torch.tensor(a, dtype=torch.float32) for a in (curve.scale, *curve.range, curve.coefficients)
    )
    inputs = torch.cat([common[..., None], common[..., None] - means], dim=-1)
    held = torch.minimum(torch.maximum(inputs, low), high)
    factors = torch.cat([torch.ones_like(held[..., :1]), held / scale], dim=-1)
    first, second, third = (factors[..., index] for index in product_indices(held.shape[-1]).T)
    static = _static_strain(curve.gauge, held[..., 0])
    strain = (first * second * third) @ coefficients[:-1] + coefficients[-1] * static
    return strain + _static_strain(curve.gauge, common) - static


def _static_strain(gauge: StaticGauge, common: torch.Tensor) -> torch.Tensor:
    """Return `StaticGauge.stretched_strain` as a sum of ramps."""
    slopes = np.diff(gauge.strain_knots) / np.diff(gauge.change_knots)
    strain = float(slopes[0]) * common
    for knot, bend in zip(gauge.change_knots[1:-1].tolist(), np.diff(slopes).tolist(), strict=True):
        strain = strain + bend * torch.relu(common - knot)
    return strain.clamp(max=gauge.most_strain)


def sample_loss(
    error: torch.Tensor, log_variance: torch.Tensor, counted: torch.Tensor, likelihood: bool
) -> torch.Tensor:
    """Return the mean over the counted samples of -log likelihood, or of the squared error before sigma learns."""
    loss = 0.5 * (error**2 * torch.exp(-log_variance) + log_variance) if likelihood else error**2
    return (loss * counted).sum() / counted.sum().clamp(min=1)


def scaled_gaussian_loss(error: torch.Tensor, log_variance: torch.Tensor, counted: torch.Tensor) -> torch.Tensor:
    """Return the Gaussian loss with sigma multiplied by what makes it least: sigma is scaled after the training."""
    count = counted.sum().clamp(min=1)
    mean_square = (error**2 * torch.exp(-log_variance) * counted).sum() / count
    return 0.5 * ((log_variance * counted).sum() / count + torch.log(mean_square + 1e-12) + 1)
