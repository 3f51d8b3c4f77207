"""The smallest structure that evaluation can be worked by hand on: one free node over three anchors."""

import numpy as np

from tensegraph import Reconstruction, Status, Structure
from tensegraph.models.evaluation.truth import Truth
from tensegraph.models.structure.reconstruction import Propagated
from tensegraph.models.structure.shape import Covariances
from tensegraph.models.values.readings import Mode

TRUE_M = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0.05, 0.05, 0.1]])


def four_nodes() -> Structure:
    """Three anchors, one free node on a rod and two tendons (a square J); one face, 1-2-3."""
    tendons = np.array([[0, 1], [1, 2], [1, 3], [2, 3]])
    return Structure(np.array([[0, 3]]), tendons, np.array(0.12), np.array(0.1), np.array([0, 1, 2]), TRUE_M[:3].copy())


def estimate_of(structure, position_m, variance_m2=(1e-6, 4e-6, 4e-6), t_s=None, flags=None) -> Reconstruction:
    """An estimate with measured lengths 1 mm too long, with a sigma of 1 mm."""
    count, tendons = len(position_m), len(structure.tendons)
    sigma_m = np.full((count, tendons), 0.001)
    covariance = np.broadcast_to(np.diag(variance_m2), (count, structure.node_count, 3, 3))
    return Reconstruction(
        structure=structure,
        t_s=np.arange(count) / 50 if t_s is None else np.asarray(t_s),
        node_position_m=position_m,
        covariances=Covariances.of_nodes(covariance),
        status=(Status.OK,) * count,
        length_m=structure.tendon_length_m(position_m) + 0.001,
        sigma_m=sigma_m,
        mode=np.full((count, tendons), int(Mode.STRETCHING)),
        flags=np.zeros((count, tendons), dtype=np.int64) if flags is None else flags,
        propagated=Propagated(0.5 * sigma_m, np.full(count, np.nan), np.full((count, 3, 3), np.nan)),
    )


def moved(error_mm) -> np.ndarray:
    """(frames, nodes, 3): the free node off by so much in each frame."""
    position = np.repeat(TRUE_M[None], len(error_mm), axis=0)
    position[:, 3] += 1e-3 * np.asarray(error_mm)
    return position


def truth_of(count, **more) -> Truth:
    return Truth(np.arange(count) / 50, np.repeat(TRUE_M[None], count, axis=0), **more)
