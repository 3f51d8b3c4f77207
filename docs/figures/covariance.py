"""Draws covariance.png: whether the ellipsoids of the example trial hold the truth as often as they say."""

import numpy as np
from drawing import BLACK, BLUE, GREY, ORANGE, TRIAL, save
from matplotlib.figure import Figure

from tensegraph import open_trial, reconstruct
from tensegraph.models.evaluation.alignment import interpolated_within
from tensegraph.models.evaluation.consistency import coverage, normalised_error_squared

NODE = 8


def main() -> None:
    """Draw the figure."""
    truth = open_trial(TRIAL).truth()
    assert truth is not None
    figure = Figure(figsize=(12, 4.2), layout="constrained")
    shares, time = figure.subplots(1, 2, width_ratios=[1, 1.7])
    probability = np.linspace(0.01, 0.995, 100)
    shares.plot([0, 100], [0, 100], color=GREY, ls="--", label="as they say")
    for method, colour in (("batch", BLUE), ("live", ORANGE)):
        result = reconstruct(TRIAL, method)
        free = result.structure.free_nodes
        error_m = result.node_position_m - interpolated_within(result.t_s, truth.t_s, truth.node_position_m)
        nees = normalised_error_squared(error_m[:, free], result.node_covariance_m2[:, free])
        inside = [coverage(nees, p) for p in probability]
        shares.plot(100 * probability, 100 * np.array(inside), color=colour, label=method)
        if method == "batch":
            sigma_mm = 1e3 * np.sqrt(result.node_covariance_m2[:, NODE, 2, 2])
            time.fill_between(
                result.t_s, -1.96 * sigma_mm, 1.96 * sigma_mm, color=BLUE, alpha=0.25, lw=0, label="95 % band"
            )
            time.plot(result.t_s, 1e3 * error_m[:, NODE, 2], color=BLACK, lw=0.9, label="error")
    shares.set(xlabel="probability of the ellipsoids [%]", ylabel="share that hold the truth [%]")
    shares.set(xlim=(0, 100), ylim=(0, 100), title="(a) coverage, all free nodes and frames")
    shares.legend(frameon=False)
    shares.grid(alpha=0.3)
    time.axhline(0, color=GREY, lw=0.7)
    time.set(xlabel="time [s]", ylabel="height: estimate minus truth [mm]", title=f"(b) node {NODE}, batch")
    time.set_ylim(-7, 8)
    time.legend(frameon=False, ncols=2, loc="upper right")
    save(figure, "covariance.png")


if __name__ == "__main__":
    main()
