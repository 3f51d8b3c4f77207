"""Check of tensors from a file against the axes that they must have; what does not fit gives an error of one line."""

from collections.abc import Mapping
from math import prod

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .units import LARGEST_NUMBER

Tensors = Mapping[str, NDArray[np.float64]]


def checked_tensors(tensors: Tensors, axes: Mapping[str, str], sizes: Mapping[str, int]) -> Tensors:
    """Return tensors as float64 after a check of their shapes and numbers.

    Args:
        tensors: names to tensors of any type and shape; those without axes are left out.
        axes: names to axes such as `4 hidden, features`: a product of numbers and of names of sizes for each axis.
        sizes: sizes by their names; a name that is missing here is the size of the first axis called by it alone.

    Raises:
        InputError: naming the tensor, what was expected, and what it got.
    """
    known = dict(sizes)
    checked = {}
    for name, text in axes.items():
        if name not in tensors:
            raise InputError(f"tensor '{name}' is missing")
        tensor = tensors[name]
        words = [axis.split() for axis in text.split(",")]
        for axis, size in zip(words, tensor.shape, strict=False):
            if len(axis) == 1 and not axis[0].isdecimal():
                known.setdefault(axis[0], size)
        expected = tuple(prod(int(w) if w.isdecimal() else known.get(w, 0) for w in axis) for axis in words)
        if tensor.shape != expected or not tensor.size:
            raise InputError(f"tensor '{name}': expected the shape ({text}) = {expected}, got {tensor.shape}")
        checked[name] = _numbers(name, tensor)
    return checked


def check_rising(name: str, values: NDArray[np.float64]) -> None:
    """Check that at least two numbers increase, as those between which a curve is interpolated.

    Raises:
        InputError: naming the tensor.
    """
    if len(values) < 2 or (np.diff(values) <= 0).any():
        raise InputError(f"tensor '{name}': expected at least two numbers, each greater than the one before")


def check_covariance(name: str, matrix: NDArray[np.float64]) -> None:
    """Check that a matrix is symmetric and has no negative eigenvalue, but for rounding.

    Raises:
        InputError: naming the tensor.
    """
    eigenvalues = np.linalg.eigvalsh(matrix)
    if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=0) or eigenvalues[0] < -1e-6 * eigenvalues[-1]:
        raise InputError(f"tensor '{name}': expected a covariance: symmetric, without a negative eigenvalue")


def _numbers(name: str, tensor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a tensor as float64, all of whose numbers are finite."""
    if not np.issubdtype(tensor.dtype, np.floating):
        raise InputError(f"tensor '{name}': expected floating-point numbers, got {tensor.dtype}")
    values = np.asarray(tensor, dtype=np.float64)
    if not np.isfinite(values).all():
        raise InputError(f"tensor '{name}' has values that are not finite")
    if np.abs(values).max() > LARGEST_NUMBER:
        raise InputError(f"tensor '{name}': expected magnitudes of at most {LARGEST_NUMBER:g}")
    return values
