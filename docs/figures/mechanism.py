"""Draws mechanism.png and two_shapes.png: what the lengths of the example trial determine, and what they do not."""

import numpy as np
from drawing import BLUE, GREEN, GREY, ORANGE, TRIAL, draw_structure, save, set_space
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy.optimize import least_squares

from tensegraph import Settings, Structure, open_trial, reconstruct
from tensegraph.estimator.rest.rest_step import rest_shape_of
from tensegraph.models.balance.statics import Statics
from tensegraph.models.structure.lengths import member_length_m
from tensegraph.models.structure.rigidity import free_length_jacobian, rigidity

LOADED_S = 3.4
"""Nodes 8 and 11 carry 3 N each then."""
ARROW = 90.0
"""Millimetres for a node that moves by 1 along the unit motion."""


def other_exact_shape(structure: Structure, position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the nearest other shape that has exactly the same lengths."""
    length_m = member_length_m(position_m, structure.free_members)

    def residual(coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        return 1e3 * (member_length_m(structure.position_m(coordinates), structure.free_members) - length_m)

    motion = rigidity(structure, position_m).mechanism
    found = []
    for step_m in np.arange(-0.2, 0.21, 0.02):
        start = (position_m + step_m * motion)[structure.free_nodes].ravel()
        solution = least_squares(residual, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        shape = structure.position_m(solution.x)
        away_m = float(np.linalg.norm(shape - position_m))
        if np.abs(solution.fun).max() < 1e-4 and away_m > 0.005:
            found.append((away_m, shape))
    return min(found, key=lambda pair: pair[0])[1]


def draw_mechanism(structure: Structure, rest_m: NDArray[np.float64]) -> None:
    """Draw the motion that lengths do not see, and how little they see of it."""
    figure = Figure(figsize=(13.5, 4.4), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.25)
    space = figure.add_subplot(1, 3, 1, projection="3d")
    facts = rigidity(structure, rest_m)
    draw_structure(space, structure, rest_m, GREY, numbered=True)
    space.quiver(*(1e3 * rest_m).T, *(ARROW * facts.mechanism).T, color=ORANGE, linewidth=2.0)
    set_space(space, rest_m)
    space.set_title("(a) the mechanism at rest: a twist")

    singular_value = np.linalg.svd(free_length_jacobian(structure, rest_m), compute_uv=False)
    values = figure.add_subplot(1, 3, 2)
    values.semilogy(np.arange(1, len(singular_value)), singular_value[:-1], "o", color=BLUE)
    values.semilogy(len(singular_value), singular_value[-1], "o", color=ORANGE)
    values.set(xlabel="motion, by rank", ylabel="singular value [m of length per m of motion]")
    values.set_title("(b) lengths see all motions but one")
    values.grid(alpha=0.3)

    amount_m = np.linspace(-0.03, 0.03, 121)
    generic = np.linalg.svd(free_length_jacobian(structure, rest_m))[2][len(singular_value) // 2].reshape(-1, 3)
    stiff = np.zeros_like(rest_m)
    stiff[structure.free_nodes] = generic
    change = figure.add_subplot(1, 3, 3)
    for motion, colour, label in ((facts.mechanism, ORANGE, "the mechanism"), (stiff, BLUE, "a median motion")):
        moved_m = rest_m + amount_m[:, None, None] * motion
        away_m = member_length_m(moved_m, structure.free_members) - member_length_m(rest_m, structure.free_members)
        change.plot(1e3 * amount_m, 1e3 * np.sqrt(np.mean(away_m**2, axis=1)), color=colour, label=label)
    change.axhline(0.5, color=GREY, ls="--", label="error of a measured length")
    change.set(xlabel="all nodes together moved by [mm]", ylabel="rms change of the lengths [mm]", ylim=(0, 4))
    change.set_title("(c) what it changes: second order")
    change.legend(loc="upper center", framealpha=1.0)
    change.grid(alpha=0.3)
    save(figure, "mechanism.png")


def draw_two_shapes(structure: Structure, statics: Statics, one_m: NDArray[np.float64]) -> None:
    """Draw two shapes with the same lengths, and the forces that do not balance in either."""
    other_m = other_exact_shape(structure, one_m)
    figure = Figure(figsize=(11.5, 4.6), layout="constrained")
    space = figure.add_subplot(1, 2, 1, projection="3d")
    draw_structure(space, structure, one_m, BLUE, numbered=True)
    draw_structure(space, structure, other_m, ORANGE, dashed=True)
    set_space(space, np.concatenate([one_m, other_m]))
    apart_mm = 1e3 * np.sqrt(np.mean(np.sum((one_m - other_m)[structure.free_nodes] ** 2, axis=1)))
    space.set_title(f"(a) two shapes with the same lengths, {apart_mm:.0f} mm apart (rms)")
    lines = [Line2D([], [], color=BLUE, lw=2.5), Line2D([], [], color=ORANGE, lw=2.5, ls="--")]
    space.legend(lines, ["the estimate", "the other"], loc="upper left", frameon=False)

    bars = figure.add_subplot(1, 2, 2)
    rows = 3 * len(structure.free_nodes)
    place = np.arange(len(structure.free_nodes))
    for offset, position_m, colour, label in ((-0.2, one_m, BLUE, "the estimate"), (0.2, other_m, ORANGE, "the other")):
        force_n = np.linalg.norm(statics.residual_n(position_m)[:rows].reshape(-1, 3), axis=1)
        bars.bar(place + offset, force_n, 0.38, color=colour, label=label)
    bars.axhline(0.1, color=GREEN, ls="--", label="sigma of the balance, noise.force_n")
    bars.set_xticks(place, [str(node) for node in structure.free_nodes])
    bars.set(xlabel="node", ylabel="unbalanced force across the rod [N]")
    bars.set_title("(b) forces tell them apart")
    bars.legend(framealpha=1.0)
    save(figure, "two_shapes.png")


def main() -> None:
    """Draw both figures."""
    trial = open_trial(TRIAL)
    description = trial.description
    structure = description.structure
    rest = rest_shape_of(description, Settings().rest)
    assert rest.mechanics is not None
    draw_mechanism(structure, rest.node_position_m)
    result = reconstruct(trial, "live")
    loaded_m = structure.with_anchors_placed(result.node_position_m[int(np.argmin(np.abs(result.t_s - LOADED_S)))])
    draw_two_shapes(structure, Statics(structure, rest.mechanics), loaded_m)


if __name__ == "__main__":
    main()
