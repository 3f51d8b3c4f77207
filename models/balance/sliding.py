"""Sliding: nodes that stand cannot all stay where they stand while the structure deforms.

In slow motion a body moves so that friction takes the least power. With one coefficient of friction, N_i the share of
the weight on node i, a_i its place on the floor before a step, and b_i after it, both in the axes of the body, the body
turns by R and moves by d so that

    sum_i N_i |s_i|,     s_i = R b_i + d - a_i

is least: nodes that carry much stay, those that carry little slide. It is found by least squares, again and again, with
the weights N_i / |s_i| of the solution before.
"""

import numpy as np
from numpy.typing import NDArray

ITERATIONS = 30
"""Number of solutions, after which the ways are known to a hundredth of themselves."""
STICKS_M = 1e-5
"""Way below which a node sticks."""


def least_friction_slides_m(
    before_m: NDArray[np.float64], after_m: NDArray[np.float64], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (nodes,) the ways |s_i| that nodes slide in a step.

    Args:
        before_m: (nodes, 2) a, along the floor.
        after_m: (nodes, 2) b.
        share: (nodes,) N, above 0.
    """
    slide_m = np.ones(len(share))
    for _ in range(ITERATIONS):
        weight = share / np.maximum(slide_m, STICKS_M)
        weight = weight / weight.sum()
        a = before_m - weight @ before_m
        b = after_m - weight @ after_m
        sine = weight @ (b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])
        cosine = weight @ np.sum(a * b, axis=1)
        turn = np.array([[cosine, -sine], [sine, cosine]]) / max(np.hypot(sine, cosine), 1e-300)
        slide_m = np.linalg.norm(b @ turn.T - a, axis=1)
    return slide_m
