"""The voltage divider: ADC codes to resistance, eq. (1).

Each sensor R and its known resistor R_k divide the supply voltage. The supply is also the ADC's reference, so that its
value cancels.
A code n of N means a voltage ratio (n + 1/2) / N:

    sensor to ground:  R = R_k (n + 1/2) / (N - n - 1/2)
    sensor to supply:  R = R_k (N - n - 1/2) / (n + 1/2)

The quantisation error is uniform over one step, so that sigma_R = (R + R_k)^2 / (R_k N sqrt(12)) in both cases.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..values.errors import InputError


@dataclass(frozen=True, slots=True)
class Divider:
    """One known resistor in series with each sensor, across the ADC's reference.

    Raises:
        InputError: for a resolution or resistance that is impossible.
    """

    bits: int
    known_resistor_ohm: float
    sensor_side: Literal["ground", "supply"]
    """Where the end of the sensor that is not at the known resistor is connected."""

    def __post_init__(self) -> None:
        if not 1 <= self.bits <= 24:
            raise InputError(f"adc.bits: expected 1 to 24, got {self.bits}")
        if not (np.isfinite(self.known_resistor_ohm) and self.known_resistor_ohm > 0):
            raise InputError(f"adc.known_resistor_ohm: expected a positive number, got {self.known_resistor_ohm}")

    @property
    def codes(self) -> int:
        """N, the number of codes."""
        return 1 << self.bits

    def resistance_ohm(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the resistance for each code; codes 0 and N - 1 give only a bound, see `saturated`."""
        ratio = (counts + 0.5) / (self.codes - counts - 0.5)
        return self.known_resistor_ohm * (ratio if self.sensor_side == "ground" else 1 / ratio)

    def counts(
        self, resistance_ohm: NDArray[np.float64], noise_codes: NDArray[np.float64] | float = 0.0
    ) -> NDArray[np.int64]:
        """Return the code for each resistance, 0 and infinity included.

        Args:
            resistance_ohm: resistances of the sensors.
            noise_codes: noise of the converter, in codes, which is added before the code is rounded down.
        """
        with np.errstate(divide="ignore"):
            ratio = 1 / (1 + self.known_resistor_ohm / resistance_ohm)
        ratio = ratio if self.sensor_side == "ground" else 1 - ratio
        return np.clip(np.floor(ratio * self.codes + noise_codes), 0, self.codes - 1).astype(np.int64)

    def sigma_ohm(self, resistance_ohm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviation of the quantisation error at a resistance."""
        sigma: NDArray[np.float64] = (resistance_ohm + self.known_resistor_ohm) ** 2 / (
            self.known_resistor_ohm * self.codes * np.sqrt(12)
        )
        return sigma

    def saturated(self, counts: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return where the code is 0 or full scale."""
        return (counts <= 0) | (counts >= self.codes - 1)
