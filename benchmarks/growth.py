"""How time and memory grow with the struts: `growth.py [--figure docs/figures/growth.png]`.

Towers of three-strut prisms without weight sway by 5 mm, so that their rods keep their lengths; all tendons are
measured with an error of 0.6 mm. Each tower is estimated in a process of its own, live and in batch.
"""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.linalg import null_space

from tensegraph import Settings, Structure, prism_tower
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.rest.rest_step import rest_step
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.io.figures.style import BLACK, BLUE, GREY, ORANGE, add_grid, save_figure
from tensegraph.models.structure.lengths import length_jacobian, member_length_m
from tensegraph.models.structure.mechanics import Mechanics
from tensegraph.models.structure.rest_shape import GeometrySigma, RestSettings, RestShape
from tensegraph.models.values.readings import Mode, TendonLengths

STRUTS = (3, 6, 12, 24, 60)
ROD_M = 0.3
SIDE_M = 0.15
STIFFNESS_N_PER_M = 400.0
SWAY_M = 0.005
SWAY_S = 2.0
SIGMA_M = 0.0006
"""Standard deviation of a length."""
STEP_S = 0.02
ESTIMATORS = {"live": LiveSmoother, "batch": BatchOptimizer}
STYLES = {"live": (BLUE, "o"), "batch": (ORANGE, "s")}
"""Colour and marker of each method."""
FRAMES = 300


@dataclass(frozen=True, slots=True)
class Cost:
    """What it takes to estimate a tower."""

    struts: int
    tendons: int
    method: str
    ms: float
    """Of CPU, a frame."""
    mb: float
    """By which the memory of the process grows."""


def tower(struts: int) -> RestShape:
    """Return the rest shape of a tower without weight."""
    structure, position_m = prism_tower(struts // 3, ROD_M, SIDE_M)
    stiffness = np.full(len(structure.tendons), STIFFNESS_N_PER_M)
    mechanics = Mechanics(stiffness, structure.natural_length_m, rod_mass_kg=0.0, push_back=0.0)
    rest = rest_step(structure, mechanics, position_m, GeometrySigma(), RestSettings())
    return replace(rest, at_start=True)


def sway_m(structure: Structure, position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (nodes, 3) the sideways motion in proportion to height, as far as the rods let it be; at most SWAY_M."""
    free = structure.free_coordinates
    allowed = null_space(length_jacobian(position_m, structure.rods, free))
    wanted = np.zeros_like(position_m)
    wanted[:, 0] = position_m[:, 2]
    motion = np.zeros(position_m.size)
    motion[free] = allowed @ (allowed.T @ wanted.ravel()[free])
    return SWAY_M * motion.reshape(-1, 3) / np.linalg.norm(motion.reshape(-1, 3), axis=1).max()


def measured(rest: RestShape, frames: int) -> list[TendonLengths]:
    """Return the lengths of a tower that sways."""
    structure, position_m = rest.structure, rest.node_position_m
    random, count = np.random.default_rng(1), len(structure.tendons)
    motion_m, mode = sway_m(structure, position_m), np.full(count, int(Mode.STRETCHING))
    lengths = []
    for t_s in STEP_S * np.arange(frames):
        shape_m = position_m + motion_m * np.sin(2 * np.pi * t_s / SWAY_S)
        length_m = member_length_m(shape_m, structure.tendons) + SIGMA_M * random.standard_normal(count)
        lengths.append(TendonLengths(float(t_s), length_m, np.full(count, SIGMA_M), mode, np.zeros_like(mode)))
    return lengths


def memory_kb(kind: str) -> int:
    """Return the memory of this process as Linux tells it: `VmRSS` now, or `VmHWM` at most so far."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(kind))


def cost(struts: int, frames: int, method: str) -> Cost:
    """Return what one estimate of a tower takes, in this process."""
    rest = tower(struts)
    lengths = measured(rest, frames)
    before_kb = memory_kb("VmRSS")
    start_s = time.process_time()
    for _ in ESTIMATORS[method](rest.structure, rest, Settings()).estimate(lengths):
        pass
    took_s = time.process_time() - start_s
    grown_kb = memory_kb("VmHWM") - before_kb
    return Cost(struts, len(rest.structure.tendons), method, 1e3 * took_s / frames, grown_kb / 1024)


def costs(frames: int) -> Iterator[Cost]:
    """Yield the costs of each tower, by each method; each is measured in a process of its own."""
    for struts in STRUTS:
        for method in ESTIMATORS:
            command = [sys.executable, __file__, "--frames", str(frames), "--struts", str(struts), "--method", method]
            yield Cost(**json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))


def table(measured_costs: list[Cost]) -> Iterator[str]:
    """Yield the rows of a Markdown table, one for each tower."""
    yield "| struts | tendons | live, ms | batch, ms | live, MB | batch, MB |"
    yield "|---|---|---|---|---|---|"
    for struts in STRUTS:
        live, batch = (
            one for method in ESTIMATORS for one in measured_costs if (one.struts, one.method) == (struts, method)
        )
        yield f"| {struts} | {live.tendons} | {live.ms:.1f} | {batch.ms:.1f} | {live.mb:.0f} | {batch.mb:.0f} |"


def draw(measured_costs: list[Cost], path: Path) -> None:
    """Draw the time of a frame over the number of struts, both on logarithmic scales."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axis = figure.subplots()
    for method, (colour, marker) in STYLES.items():
        of_method = [one for one in measured_costs if one.method == method]
        struts, ms = [one.struts for one in of_method], [one.ms for one in of_method]
        axis.loglog(struts, ms, color=colour, marker=marker, label=method)
    axis.axhline(1e3 * STEP_S, color=GREY, ls="--", lw=1)
    axis.annotate("50 frames a second", (STRUTS[1], 1e3 * STEP_S), color=BLACK, va="bottom", fontsize=9)
    axis.set_xticks(STRUTS, [str(struts) for struts in STRUTS])
    axis.minorticks_off()
    axis.set_xlabel("struts")
    axis.set_ylabel("CPU time of a frame [ms]")
    axis.legend(frameon=False)
    axis.set_title("Towers of three-strut prisms: from some 24 struts on, time grows with their square", fontsize=10)
    axis.yaxis.set_major_formatter("{x:g}")
    add_grid(axis)
    save_figure(figure, path)


def main(
    frames: int = FRAMES,
    figure: Annotated[Path | None, typer.Option(help="Path of the figure.")] = None,
    struts: Annotated[int | None, typer.Option(help="Measure this tower alone, and print JSON.")] = None,
    method: Annotated[str, typer.Option(help="By this method: live or batch.")] = "live",
) -> None:
    if struts is not None:
        print(json.dumps(asdict(cost(struts, frames, method))))
        return
    measured_costs = list(costs(frames))
    for line in table(measured_costs):
        print(line)
    if figure is not None:
        draw(measured_costs, figure)


if __name__ == "__main__":
    typer.run(main)
