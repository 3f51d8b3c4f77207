"""Draws forces.png: the balance of forces of the example trial, at rest and under load."""

import numpy as np
from drawing import BLACK, BLUE, GREY, ORANGE, TRIAL, save
from matplotlib.figure import Figure

from tensegraph import Settings, open_trial, reconstruct
from tensegraph.estimator.rest.rest_step import rest_shape_of
from tensegraph.models.balance.observable_loads import observable_part
from tensegraph.models.balance.statics import Statics

NODE = 8


def main() -> None:
    """Draw the figure."""
    trial = open_trial(TRIAL)
    description = trial.description
    structure = description.structure
    rest = rest_shape_of(description, Settings().rest)
    assert description.mechanics is not None
    assert rest.mechanics is not None
    figure = Figure(figsize=(12, 4.2), layout="constrained")
    bars, time = figure.subplots(1, 2, width_ratios=[1, 1.7])

    place = np.arange(len(structure.free_nodes))
    rows = 3 * len(structure.free_nodes)
    nominal = ("nominal stiffness", description.mechanics, ORANGE)
    tared = ("after taring", rest.mechanics, BLUE)
    for offset, (label, mechanics, colour) in ((-0.2, nominal), (0.2, tared)):
        residual_n = Statics(structure, mechanics).residual_n(rest.node_position_m)
        force_n = np.linalg.norm(residual_n[:rows].reshape(-1, 3), axis=1)
        bars.bar(place + offset, force_n, 0.38, color=colour, label=label)
    bars.set_xticks(place, [str(node) for node in structure.free_nodes])
    bars.set(xlabel="node", ylabel="unbalanced force at rest [N]", title="(a) taring of stiffness and natural lengths")
    bars.set_ylim(0, 1.4)
    bars.legend(frameon=False, loc="upper left", ncols=2)

    result = reconstruct(trial, "batch")
    true_loads = open_trial(TRIAL).true_loads()
    assert result.loads is not None
    assert true_loads is not None
    truth = open_trial(TRIAL).truth()
    assert truth is not None
    seen_n = observable_part(structure, true_loads.force_n, truth.node_position_m)
    time.plot(true_loads.t_s, np.linalg.norm(seen_n[:, NODE], axis=-1), color=BLACK, lw=1.0, label="true")
    estimated_n = np.linalg.norm(result.loads.force_n[:, NODE], axis=-1)
    time.plot(result.t_s, estimated_n, color=BLUE, label="estimated (batch)")
    time.axhline(Settings().load_threshold_n, color=GREY, ls="--", label="called loaded above")
    time.set(xlabel="time [s]", ylabel="external load [N]", title=f"(b) load at node {NODE}", ylim=(0, None))
    time.legend(frameon=False, loc="upper right")
    save(figure, "forces.png")


if __name__ == "__main__":
    main()
