"""Drift of each sensor's own: variables that rods and the balance of forces hold, once references tell of such drift.

The errors d of resistance follow the model of `models.sensor.drift`: d' stationary with sigma s_o, forgotten slowly.
Off the readings comes the references' mean already, and with it the mean of their own drifts; what is left has

    Cov(d'_e, d'_f) = s_o^2 (delta_ef + 1 / references)

One frame's own factors, its shape eliminated, say of the lengths' errors b = h d (h metres per dR/R)

    Lambda = W - W J (J^T W J + I_rest)^-1 J^T W,     u = Lambda (b - b_used) at the minimum over shapes

where I_rest is the information of rods, shape prior and forces (Cauchy's, see `uncertainty`). A length's error lasts
for `evidence_s`, so that much of time counts as one frame. Live this is a Kalman filter, in batch its smoother.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..factors.equilibrium import squared_norms
from ..factors.noise import tendon_sigma_m
from ..models.sensor.drift import DriftSettings, drift_transition
from ..models.structure.lengths import length_jacobian, member_length_m
from ..models.structure.shape import Shape
from ..models.values.readings import TendonLengths
from .graph import GraphBuilder


@dataclass(frozen=True, slots=True, eq=False)
class DriftState:
    """Levels and rates of all sensors' own drift at one time."""

    t_s: float
    mean: NDArray[np.float64]
    """(2 tendons,) dR/R, then 1/s."""
    covariance: NDArray[np.float64]
    """(2 tendons, 2 tendons)"""

    def off(self, lengths: TendonLengths) -> TendonLengths:
        """Return the lengths without this drift; what is not known of it goes into their sigma."""
        drift, count = lengths.drift, len(lengths.length_m)
        assert drift is not None, "own drift needs resistances"
        h, level, covariance = drift.per_change_m, self.mean[:count], self.covariance[:count, :count]
        covariance_m2 = h[:, None] * covariance * h
        own_variance = np.diag(covariance)
        return replace(
            lengths,
            length_m=lengths.length_m - h * level,
            sigma_m=np.sqrt(lengths.sigma_m**2 + np.diag(covariance_m2)),
            drift=replace(
                drift,
                change=drift.change + level,
                sigma=np.sqrt(drift.sigma**2 + own_variance),
                covariance_m2=covariance_m2,
            ),
        )


@dataclass(frozen=True, slots=True, eq=False)
class DriftUpdate:
    """One step of the filter, as the smoother needs it."""

    foretold: DriftState
    transition: NDArray[np.float64]
    """(2 tendons, 2 tendons) from the update before."""
    state: DriftState


class OwnDrift:
    """Estimates each sensor's own drift, frame by frame."""

    def __init__(self, builder: GraphBuilder, settings: DriftSettings) -> None:
        self._builder, self._settings = builder, settings
        self._count = len(builder.structure.tendons)
        self._rate_variance, self._first_s = 0.0, np.nan
        self._state: DriftState | None = None
        self._foretold: tuple[DriftState, NDArray[np.float64]] | None = None
        self._updated_s = np.nan
        self.kept: list[DriftUpdate] | None = None
        """Every update, for a smoother that puts a list here; live, memory is bounded."""

    def admit(self, lengths: TendonLengths) -> TendonLengths:
        """Return the lengths without the drift that is known by now; the same ones while sensors do not differ."""
        if np.isnan(self._first_s):
            self._first_s = lengths.t_s
        drift, self._foretold = lengths.drift, None
        if drift is None or self._builder.statics is None:
            return lengths
        if self._state is None and drift.own_rate_per_s == 0:
            return lengths
        self._awaken(lengths.t_s, drift.own_rate_per_s**2, drift.references)
        assert self._state is not None
        step_s = lengths.t_s - self._state.t_s
        if np.isnan(self._updated_s) or step_s >= self._settings.update_every_s:
            self._foretold = self._predicted(lengths.t_s, drift.own_rate_per_s**2, drift.references)
            self._state = self._foretold[0]
        return self._state.off(lengths)

    def observe(self, shape: Shape) -> None:
        """Learn from a frame whose lengths were admitted."""
        if self._foretold is None:
            return
        foretold, transition = self._foretold
        information, gradient = self._evidence(shape)
        since_s = self._settings.update_every_s if np.isnan(self._updated_s) else shape.t_s - self._updated_s
        share = min(since_s / self._settings.evidence_s, 1.0)
        n = self._count
        crossed = foretold.covariance[:, :n]
        inner = np.eye(n) + share * information @ foretold.covariance[:n, :n]
        solved = np.linalg.solve(inner, share * np.column_stack([information @ crossed.T, gradient]))
        covariance = foretold.covariance - crossed @ solved[:, :-1]
        mean = foretold.mean + crossed @ solved[:, -1]
        self._state = DriftState(shape.t_s, mean, 0.5 * (covariance + covariance.T))
        self._updated_s = shape.t_s
        if self.kept is not None:
            self.kept.append(DriftUpdate(foretold, transition, self._state))

    def _awaken(self, t_s: float, rate_variance: float, references: int) -> None:
        """Give what was thought to drift less the spread that it would have had from the start."""
        more = rate_variance - self._rate_variance
        if self._state is None:
            self._state = DriftState(t_s, np.zeros(2 * self._count), np.zeros((2 * self._count,) * 2))
        if more > 0:
            since_s = t_s - self._first_s
            in_time = np.array([[since_s**2, since_s], [since_s, 1.0]])
            added = more * np.kron(in_time, _between_sensors(self._count, references))
            self._state = replace(self._state, covariance=self._state.covariance + added)
            self._rate_variance = rate_variance

    def _predicted(self, t_s: float, rate_variance: float, references: int) -> tuple[DriftState, NDArray[np.float64]]:
        assert self._state is not None
        n = self._count
        transition, keep = drift_transition(n, t_s - self._state.t_s, self._settings.memory_s)
        covariance = transition @ self._state.covariance @ transition.T
        covariance[n:, n:] += (1 - keep**2) * rate_variance * _between_sensors(n, references)
        return DriftState(t_s, transition @ self._state.mean, covariance), transition

    def _evidence(self, shape: Shape) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return Lambda and u, both of dR/R."""
        drift = shape.lengths.drift
        assert drift is not None
        information, gradient = length_evidence(self._builder, shape.node_position_m, shape.lengths)
        h = drift.per_change_m
        return h[:, None] * information * h, h * gradient


def length_evidence(
    builder: GraphBuilder, node_position_m: NDArray[np.float64], lengths: TendonLengths
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what a frame says of errors of its lengths: the (tendons, tendons) information and (tendons,) gradient.

    Args:
        builder: of the frame's factors, equilibrium among them.
        node_position_m: (nodes, 3) near the minimum.
        lengths: with the drift taken off; what is not known of it does not count.
    """
    structure, noise, statics = builder.structure, builder.noise, builder.statics
    assert statics is not None, "own drift needs the balance of forces"
    free, x = structure.free_coordinates, node_position_m
    variance = tendon_sigma_m(lengths, noise) ** 2
    if lengths.drift is not None and lengths.drift.covariance_m2 is not None:
        variance = variance - np.diag(lengths.drift.covariance_m2)
    weight = np.where(np.isfinite(variance), 1 / variance, 0.0)
    by_length = length_jacobian(x, structure.tendons).reshape(len(weight), -1)[:, free]
    by_rod = length_jacobian(x, structure.rods).reshape(len(structure.rods), -1)[:, free] / noise.rod_m
    error = structure.tendon_length_m(x) - np.nan_to_num(lengths.length_m)
    rod_error = (member_length_m(x, structure.rods) - structure.rod_length_m) / noise.rod_m
    from_rest = (x - builder.rest.node_position_m).ravel()[free] / noise.shape_prior_m**2
    force, by_position = statics.residual_and_jacobian(x)
    excused = 1 / (1 + squared_norms(force / noise.force_n, statics))
    by_force = by_position[:, free] / noise.force_n
    held = by_rod.T @ by_rod + np.eye(len(free)) / noise.shape_prior_m**2
    held += (by_force * excused[:, None] ** 2).T @ by_force
    slope = by_rod.T @ rod_error + from_rest + by_force.T @ (excused * force / noise.force_n)
    slope += by_length.T @ (weight * error)
    weighted = by_length * weight[:, None]
    shape_covariance = np.linalg.inv(held + by_length.T @ weighted)
    information = np.diag(weight) - weighted @ shape_covariance @ weighted.T
    return information, weighted @ (shape_covariance @ slope) - weight * error


def smoothed(updates: Sequence[DriftUpdate]) -> list[DriftState]:
    """Return the states given all updates, later ones too (Rauch, Tung and Striebel)."""
    if not updates:
        return []
    states = [updates[-1].state]
    for update, after in zip(updates[-2::-1], updates[:0:-1], strict=True):
        here, foretold = update.state, after.foretold
        crossed = after.transition @ here.covariance
        back = np.linalg.lstsq(foretold.covariance, crossed, rcond=1e-12)[0].T
        mean = here.mean + back @ (states[-1].mean - foretold.mean)
        covariance = here.covariance + back @ (states[-1].covariance - foretold.covariance) @ back.T
        states.append(DriftState(here.t_s, mean, covariance))
    return states[::-1]


def _between_sensors(count: int, references: int) -> NDArray[np.float64]:
    return np.eye(count) + 1 / max(references, 1)
