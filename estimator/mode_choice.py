"""The mode of each tendon, stretched or bent, as the other tendons and the balance of forces tell it.

Near zero strain a bent and a stretched strip have the same resistance, and lengths that differ by up to 10 mm. The
probability p of the reading alone is therefore multiplied by the evidence of the shape: with the length l_c and its
sigma_c that follow from all else (the cavity: the estimate without this reading), and the readings y_m and sigma_m in
the modes m,

    log-odds = log(p / (1 - p)) + alpha <log(N_b / N_s)>,     N_m = N(y_m; l_c, sigma_m^2 + sigma_c^2)

The mean <.> is over `EVIDENCE_S`, because a tendon does not change its mode from frame to frame; alpha is `LIVE_SHARE`,
or in batch `BATCH_SHARE`. The length is the mean of both modes, and its variance includes the distance between them.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.special import expit, logit

from ..factors.noise import WeightedLengths
from ..models.structure.lengths import length_and_jacobian, propagated_variance
from ..models.structure.shape import Shape
from ..models.values.readings import (
    BENDING,
    LEAST_PROBABILITY,
    STRETCHING,
    Flag,
    ModeReadings,
    TendonLengths,
    is_mode_uncertain,
)
from ..models.values.time_series import interpolated, low_pass_weight, median_step_s
from .graph import GraphBuilder

EVIDENCE_S = 0.1
"""Time over which the evidence of the shape is averaged: a tendon goes slack in a push of this length."""
LIVE_SHARE = 0.4
"""Share of the evidence that counts: what follows from all else has errors that last for seconds, and other tendons of
uncertain mode. With 0.7, errors of 14 slack trials are 2 % smaller, but 1.3 times as many nodes are `ok` and far
outside of their ellipsoids."""
BATCH_SHARE = 0.7
"""The same where later shapes tell it, too. With 0.4, errors of these trials are 4 % larger, and as many nodes are far
outside of their ellipsoids."""
MOST_LOG_ODDS = 20.0
"""Limit of the evidence of one frame."""


class ModeChoice:
    """Chooses the mode of each tendon, frame by frame."""

    def __init__(self, builder: GraphBuilder, ambiguous_probability: float) -> None:
        self._builder = builder
        self._ambiguous_probability = ambiguous_probability
        self._log_odds = np.zeros(len(builder.structure.tendons))
        self._last_s = np.nan
        self.kept: list[tuple[float, NDArray[np.float64]]] | None = None
        """Time and (tendons,) evidence of frames, for a smoother that puts a list here; live, memory is bounded."""
        self.share = LIVE_SHARE
        """Share of the evidence that counts."""

    def choose(self, lengths: TendonLengths) -> TendonLengths:
        """Return the lengths with the evidence of the shapes before."""
        return self._chosen(lengths, self._log_odds)

    def observe(self, shape: Shape, measured: WeightedLengths) -> None:
        """Learn from a frame that was estimated from the measured lengths."""
        if self._builder.statics is None:
            return
        step_s = shape.t_s - self._last_s if np.isfinite(self._last_s) else 0.0
        self._last_s = shape.t_s
        evidence = np.zeros(len(self._log_odds))
        modes = measured.lengths.modes
        if modes is not None and is_uncertain(measured.lengths):
            evidence = self.evidence(
                shape.node_position_m,
                shape.covariance_m2,
                measured.lengths.length_m,
                measured.sigma_m,
                modes,
            )
        self._log_odds += low_pass_weight(step_s, EVIDENCE_S) * (self.share * evidence - self._log_odds)
        if self.kept is not None:
            self.kept.append((shape.t_s, evidence))

    def smoothed(self, frames: Sequence[TendonLengths]) -> list[TendonLengths]:
        """Return the lengths with the evidence of all shapes that were kept, later ones too."""
        if not self.kept or len(self.kept) < 2:
            return list(frames)
        kept_s = np.array([t_s for t_s, _ in self.kept])
        evidence = np.array([evidence for _, evidence in self.kept])
        samples = EVIDENCE_S / median_step_s(kept_s)
        log_odds = self.share * gaussian_filter1d(evidence, samples, axis=0, mode="nearest")
        between = interpolated(np.array([lengths.t_s for lengths in frames]), kept_s, log_odds)
        return list(map(self._chosen, frames, between))

    def evidence(
        self,
        node_position_m: NDArray[np.float64],
        covariance_m2: NDArray[np.float64],
        length_m: NDArray[np.float64],
        sigma_m: NDArray[np.float64],
        modes: ModeReadings,
    ) -> NDArray[np.float64]:
        """Return (..., tendons) the log-likelihood ratio of bent to stretched, of shapes without each reading.

        Args:
            node_position_m: (..., nodes, 3) the shapes.
            covariance_m2: (..., 3 nodes, 3 nodes) their covariances.
            length_m: (..., tendons) the lengths from which they were estimated.
            sigma_m: (..., tendons) their standard deviations in the graph.
            modes: (..., 2, tendons) the lengths in each mode.
        """
        structure = self._builder.structure
        shape_m, jacobian = length_and_jacobian(node_position_m, structure.tendons)
        variance = propagated_variance(jacobian, covariance_m2 - self._builder.rest.covariance_m2)
        share = np.minimum(variance / sigma_m**2, 0.95)  # of the reading in the estimated length
        read_m = np.nan_to_num(length_m)
        cavity_m = (shape_m - share * read_m) / (1 - share)
        spread = modes.sigma_m**2 + (variance / (1 - share))[..., None, :]
        log_density = -0.5 * ((modes.length_m - cavity_m[..., None, :]) ** 2 / spread + np.log(spread))
        ratio = log_density[..., BENDING, :] - log_density[..., STRETCHING, :]
        known = np.isfinite(ratio) & structure.is_free_tendon
        return np.where(known, np.clip(ratio, -MOST_LOG_ODDS, MOST_LOG_ODDS), 0.0)

    def _chosen(self, lengths: TendonLengths, log_odds: NDArray[np.float64]) -> TendonLengths:
        """Return the lengths with log-odds of bending added to those of the readings alone."""
        modes = lengths.modes
        if modes is None:
            return lengths
        alone = modes.bending_probability
        asked = lengths.usable & is_mode_uncertain(alone)
        if not asked.any():
            return lengths
        bent = expit(logit(np.clip(alone, LEAST_PROBABILITY, 1 - LEAST_PROBABILITY)) + log_odds)
        length_m = (1 - bent) * modes.length_m[0] + bent * modes.length_m[1]
        variance = (1 - bent) * (modes.sigma_m[0] ** 2 + (modes.length_m[0] - length_m) ** 2)
        variance += bent * (modes.sigma_m[1] ** 2 + (modes.length_m[1] - length_m) ** 2)
        stretched_share = (1 - bent) / (1 - np.clip(alone, LEAST_PROBABILITY, 1 - LEAST_PROBABILITY))
        error = lengths.model_error
        if error is not None:
            error = replace(error, sigma_m=np.where(asked, stretched_share, 1.0) * error.sigma_m)
        drift = lengths.drift
        if drift is not None:
            drift = replace(drift, stretched_share=np.where(asked, 1 - bent, drift.stretched_share))
        ambiguous = np.where(np.minimum(bent, 1 - bent) > self._ambiguous_probability, int(Flag.AMBIGUOUS), 0)
        return replace(
            lengths,
            length_m=np.where(asked, length_m, lengths.length_m),
            sigma_m=np.where(asked, np.sqrt(variance), lengths.sigma_m),
            rest_sigma_m=np.where(asked, lengths.rest_sigma_m * np.sqrt(stretched_share), lengths.rest_sigma_m),
            model_error=error,
            drift=drift,
            mode=np.where(asked, (bent > 0.5).astype(np.int64), lengths.mode),
            flags=np.where(asked, (lengths.flags & ~int(Flag.AMBIGUOUS)) | ambiguous, lengths.flags),
        )


def stacked_modes(frames: Sequence[TendonLengths]) -> ModeReadings:
    """Return the readings of several frames, all of which have modes, with a leading axis of frames."""
    modes = [lengths.modes for lengths in frames if lengths.modes is not None]
    return ModeReadings(
        np.array([one.length_m for one in modes]),
        np.array([one.sigma_m for one in modes]),
        np.array([one.bending_probability for one in modes]),
    )


def is_uncertain(lengths: TendonLengths) -> bool:
    """Return whether the reading alone does not tell the mode of some tendon."""
    return lengths.modes is not None and bool(is_mode_uncertain(lengths.modes.bending_probability).any())
