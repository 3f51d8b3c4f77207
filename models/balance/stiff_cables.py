"""Stiff cables, whose tension does not follow from their length: a tenth of a millimetre may be all of it.

While a cable may be taut its tension T is unknown, but it pulls; a slack one has none. With B = d(rows)/dT, what is
left of the rows r of the balance of forces, whatever the tensions of the cables that pull are, is

    r' = r + B T = (I - B B^+) r,    T = -B^+ r > 0

All arrays may have leading axes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .joined_rods import JOINED_RCOND

QUIET_N = 0.2
"""Standard deviation of the balance of forces where a cable's tension is judged."""
LOADED_STEPS = 5
"""Number of steps of that judgement."""


@dataclass(frozen=True, slots=True, eq=False)
class StiffCables:
    """The cables among the tendons of a structure whose tension is unknown while they are taut."""

    tendons: NDArray[np.int64]
    """(cables,) their indices among the tendons."""
    group: NDArray[np.int64]
    """(rows,) the group of each row of the balance, see `Statics.group`."""
    group_start: NDArray[np.int64]
    """(groups,) the first row of each group."""

    def pulls(
        self, rows: NDArray[np.float64], by_tension: NDArray[np.float64], may_be_taut: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return (..., cables) 1 where a cable may be taut and would pull, and 0 where it is slack.

        Args:
            rows: (..., rows) r.
            by_tension: (..., rows, cables) the rows by a tension of 1 N.
            may_be_taut: (..., cables) where a cable is long enough to be taut.
        """
        pulls = np.where(may_be_taut, 1.0, 0.0)
        changed = np.ones(pulls.shape[:-1], dtype=np.bool_)
        for _ in self.tendons:  # those that would push are slack, and others pull then
            pull = by_tension[changed] * pulls[changed][:, None, :]
            pushes = (pulls[changed] > 0) & (self.tension_n(rows[changed], pull) <= 0)
            pulls[changed] = np.where(pushes, 0.0, pulls[changed])
            changed[changed] = pushes.any(axis=-1)
            if not changed.any():
                break
        return pulls

    def tension_n(self, rows: NDArray[np.float64], pull: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., cables) the tensions with which most groups of rows balance: some may have a load.

        They minimise sum log(1 + |r_g + B_g T|^2 / sigma^2) over the groups g, as Cauchy's kernel has it.

        Args:
            rows: (..., rows) r.
            pull: (..., rows, cables) B; zero for cables that do not pull, whose tension is zero then.
        """
        rows = rows[..., None]
        tension = -_inverse(pull) @ rows
        for _ in range(LOADED_STEPS):
            left = (rows + pull @ tension)[..., 0]
            squared = np.add.reduceat(left**2, self.group_start, axis=-1)[..., self.group]
            root = 1 / np.sqrt(1 + squared / QUIET_N**2)[..., None]
            tension = -_inverse(root * pull) @ (root * rows)
        return np.asarray(tension[..., 0])

    def rank_taken(self, pull: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (rows,) the number of independent rows that the cables take of the group of each row."""
        taken = np.sum(pull * _inverse(pull).T, axis=1)
        return np.asarray(np.add.reduceat(taken, self.group_start)[self.group])


def without_cables(rows: NDArray[np.float64], pull: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., rows, n) what is left of rows, whatever the tensions of cables are.

    Args:
        rows: (..., rows, n)
        pull: (..., rows, cables) B.
    """
    return np.asarray(rows - pull @ (_inverse(pull) @ rows))


def jacobian_without_cables(
    rows: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    pull: NDArray[np.float64],
    by_pull: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return r' and its derivative (..., rows, n), from (..., rows) r and its derivative.

    With A = I - B B^+ and q = B^+ r,

        dr' = A (dr - dB q) - B^+^T dB^T r'

    Args:
        rows: (..., rows) r.
        jacobian: (..., rows, n) dr.
        pull: (..., rows, cables) B.
        by_pull: (..., cables, rows, n) dB, by cable.
    """
    inverse = _inverse(pull)
    q = (inverse @ rows[..., None])[..., 0]
    left = rows - (pull @ q[..., None])[..., 0]
    jacobian = jacobian - np.einsum("...c,...crn->...rn", q, by_pull)
    turned = np.swapaxes(inverse, -1, -2) @ np.einsum("...r,...crn->...cn", left, by_pull)
    return left, jacobian - pull @ (inverse @ jacobian) - turned


def _inverse(pull: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., cables, rows) B^+; without the tensions that rows hardly show.

    From the eigenvectors V of B^T B, which take a quarter of the time of a singular value decomposition of B.
    """
    transposed = np.swapaxes(pull, -1, -2)
    squared, V = np.linalg.eigh(transposed @ pull)
    shown = squared > JOINED_RCOND**2 * squared[..., -1:]
    inverse = np.divide(1.0, squared, out=np.zeros_like(squared), where=shown)
    return np.asarray((V * inverse[..., None, :]) @ np.swapaxes(V, -1, -2) @ transposed)
