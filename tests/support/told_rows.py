"""Rows of lengths that are told, of tendons that stretch, without flags."""

import numpy as np
from numpy.typing import ArrayLike

from tensegraph.models.values.readings import TendonLengths


def rows_of(length_m: ArrayLike, sigma_m: ArrayLike = np.nan, t_s: ArrayLike | None = None) -> list[TendonLengths]:
    """Return rows of (rows, tendons) lengths, every 20 ms where no times are given."""
    length_m = np.asarray(length_m)
    none = np.zeros(length_m.shape[1], dtype=np.int64)
    sigma_m = np.full(length_m.shape, sigma_m)
    t_s = 0.02 * np.arange(len(length_m)) if t_s is None else np.asarray(t_s)
    return [TendonLengths(t, m, s, none, none) for t, m, s in zip(t_s.tolist(), length_m, sigma_m, strict=True)]
