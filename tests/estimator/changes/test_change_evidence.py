"""The evidence for one change, against Gaussian densities and against estimates that know of the change."""

import numpy as np
from scipy.stats import multivariate_normal

from linear_frames import linear_frame
from tensegraph.estimator.changes.change_evidence import PossibleChanges, change_evidence
from tensegraph.estimator.linear_frame import LinearFrame


def frame_of(seed: int) -> LinearFrame:
    """Three lengths, of which the second and third have correlated errors, and four forces, of two coordinates."""
    rng = np.random.default_rng(seed)
    return linear_frame(
        length_error_m=rng.normal(size=3),
        length_jacobian=rng.normal(size=(3, 2)),
        weight_per_m=np.array([2.0, 1.5, 3.0]),
        drift_m2=np.array([[0.2, 0.1], [0.1, 0.05]]),
        force_n=rng.normal(size=4),
        force_jacobian=rng.normal(size=(4, 2)),
        force_weight_per_n=np.full(4, 2.0),
        force_sigma_n=np.full(4, 0.5),
        from_prior_m=rng.normal(size=2),
        prior_m=0.8,
    )


def readings_of(frame: LinearFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals of lengths and forces, their Jacobian, and the covariance of their noise."""
    noise = np.diag(np.concatenate([1 / frame.weight_per_m**2, frame.force_sigma_n**2]))
    noise[1, 2] = noise[2, 1] = frame.drift_m2[0, 1]
    residual = np.concatenate([frame.length_error_m, frame.force_n])
    return residual, np.concatenate([frame.length_jacobian, frame.force_jacobian]), noise


CHANGES = PossibleChanges(
    length_error_m=np.array([[-1.0, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.7, 0.0]]),
    force_n=np.array([[0.0, 0.0, 0.4], [0.0, 0.0, -0.3], [0.0, 1.0, 0.0], [0.0, 0.0, 0.2]]),
    sigma=np.array([0.5, 1.0, 2.0]),
)


def test_by_hand() -> None:
    """One coordinate of which two lengths of sigma 1 say 0 and 2; a change of sigma 1 of the first: I = 1/2, b = -1."""
    frame = linear_frame(
        length_error_m=np.array([1.0, -1.0]),
        length_jacobian=np.ones((2, 1)),
        weight_per_m=np.ones(2),
        from_prior_m=np.zeros(1),
        prior_m=np.inf,
    )
    found = change_evidence(frame, PossibleChanges(np.array([[-1.0], [0.0]]), np.zeros((0, 1)), np.ones(1)))
    np.testing.assert_allclose(found.log_ratio, [0.5 * np.log(2 / 3) + 1 / 3])
    np.testing.assert_allclose(found.explained, [1 / 3])
    # theta is 2/3 with a variance of 2/3, and the estimate takes up half of it, in the other direction
    np.testing.assert_allclose(found.shift_m, [[-0.5 * np.sqrt(4 / 9 + 2 / 3)]])


def test_is_the_ratio_of_the_densities_of_what_is_read() -> None:
    for seed in range(3):
        frame = frame_of(seed)
        residual, jacobian, noise = readings_of(frame)
        mean = jacobian @ -frame.from_prior_m  # what would be left at the middle of the prior
        spread = noise + frame.prior_m**2 * jacobian @ jacobian.T
        by_change = np.concatenate([CHANGES.length_error_m, CHANGES.force_n])
        none = multivariate_normal.logpdf(residual + mean, cov=spread)
        each = [
            multivariate_normal.logpdf(residual + mean, cov=spread + sigma**2 * np.outer(d, d))
            for d, sigma in zip(by_change.T, CHANGES.sigma, strict=True)
        ]
        np.testing.assert_allclose(change_evidence(frame, CHANGES).log_ratio, np.array(each) - none)


def test_shift_is_that_of_an_estimate_that_knows_of_the_change() -> None:
    """The square of the shift is the second moment of the step to the estimate that has the change as an unknown."""
    frame = frame_of(3)
    residual, jacobian, noise = readings_of(frame)
    by_change = np.concatenate([CHANGES.length_error_m, CHANGES.force_n])
    for change, shift_m in enumerate(change_evidence(frame, CHANGES).shift_m):
        both = np.column_stack([jacobian, by_change[:, change]])
        prior = np.diag([frame.prior_m**-2] * 2 + [CHANGES.sigma[change] ** -2])
        covariance = np.linalg.inv(both.T @ np.linalg.solve(noise, both) + prior)
        theta = -covariance @ (both.T @ np.linalg.solve(noise, residual) + prior @ np.append(frame.from_prior_m, 0.0))
        information = jacobian.T @ np.linalg.solve(noise, jacobian) + prior[:2, :2]
        per_change = np.linalg.solve(information, jacobian.T @ np.linalg.solve(noise, by_change[:, change]))
        expected = (theta[2] ** 2 + covariance[2, 2]) * np.outer(per_change, per_change)
        np.testing.assert_allclose(np.outer(shift_m, shift_m), expected)
