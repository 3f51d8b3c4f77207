"""Write docs/benchmarks.md anew: `python examples/benchmark_page.py [--trials DIR...] [--strips DIR] [--slow]`.

Every table of the page comes from a module of benchmarks/, and says by which command and by which source it was made.
With the example trial alone it takes a few minutes. `--only NAME` makes one part anew and leaves the others as they
stand; a part whose input is not given, or that is slow, stays too. A part that was never made stands as its heading and
its command, so that links to it hold. Parts made by different sources are named at the top of the page. Stopped, it has
kept the parts that were done.
"""

import argparse
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: times compare within a column
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

import front_end_accuracy  # noqa: E402
import growth  # noqa: E402
import held_out  # noqa: E402
import loads_by_regime  # noqa: E402
import method_comparison  # noqa: E402
import real_strips  # noqa: E402
import robustness  # noqa: E402
import sensor_worlds  # noqa: E402
import timing  # noqa: E402
from tensegraph.io.provenance import versions  # noqa: E402
from tensegraph.models.calibration.recipe import TrainingSettings  # noqa: E402

FIGURE = Path("examples/dead_sensors.png")
GROWTH_FIGURE = Path("docs/figures/growth.png")
NOT_MADE = "none"
"""Stands for the source of a part that was never made."""
PACKAGE = ("commands", "estimator", "factors", "io", "live", "models", "scoring", "benchmarks")
MARK = re.compile(r"<!-- part: (\S+), source (\S+) -->\n(.*?)<!-- end of \1 -->\n", re.DOTALL)
START = """# Benchmarks

This page is written by `python examples/benchmark_page.py`, and not by hand. Every trial here is simulated, as `kind`
and `provenance` in its `trial.toml` say; only the recordings under [Real strips](#real-strips) are of real sensors.
What the words mean is in [Evaluation](how-to/evaluation.md#what-its-words-mean). Times are of one thread.
"""


@dataclass(frozen=True)
class Inputs:
    """What the tables are made from."""

    trials: list[Path]
    strips: Path | None
    """Folder of recordings of real strips, or None."""


@dataclass(frozen=True)
class Part:
    """A section of the page."""

    name: str
    title: str
    text: str
    """What the table shows."""
    command: str
    """That prints the table alone."""
    make: Callable[[Inputs], Iterable[str]]
    """Yields its lines."""
    slow: bool = False
    """Takes many minutes."""


def wrong_mechanics(inputs: Inputs) -> list[str]:
    """Return the table of wrong mechanics, and draw the figure of dead sensors."""
    with tempfile.TemporaryDirectory() as folder:
        trials = robustness.default_trials(Path(folder))
        list(robustness.dead_sensors_figure(trials, 4, ROOT / FIGURE))
        return list(robustness.wrong_mechanics(trials, ["live", "batch"]))


def growth_by_struts() -> list[str]:
    """Return the table of growth, and draw its figure."""
    costs = list(growth.costs(growth.FRAMES))
    growth.draw(costs, ROOT / GROWTH_FIGURE)
    return list(growth.table(costs))


PARTS = [
    Part(
        name="methods",
        title="All methods on the same lengths",
        text=(
            "The factor graph beside other methods on the same lengths and sigmas: the paper's Table I, measured here."
        ),
        command="tensegraph compare TRIAL...",
        make=lambda inputs: [method_comparison.tables(inputs.trials).rstrip()],
    ),
    Part(
        name="loads",
        title="Loads, and honesty by regime",
        text=(
            "Of the batch graph: RMSE of loads in newtons at loaded nodes and at the others, share of the loaded "
            "ones that are seen above 0.2 N and of those seen that are true, share of nodes called loaded while "
            "nothing is pressed, and of frames with more than 0.3 N in which the most loaded node is the right "
            "one; then share of nodes within ellipsoids of 68 and 95 %, in quiet, loaded and slack frames."
        ),
        command="python benchmarks/loads_by_regime.py TRIAL...",
        make=lambda inputs: loads_by_regime.table(inputs.trials),
    ),
    Part(
        name="front-end",
        title="The sensor front end",
        text=(
            "Length error of the [sensor front end](concepts/architecture.md#the-method) in millimetres, against "
            "a static gauge curve tared alike; *about* is about each tendon's own mean error."
        ),
        command="python benchmarks/front_end_accuracy.py TRIAL...",
        make=lambda inputs: front_end_accuracy.table(inputs.trials),
    ),
    Part(
        name="robustness",
        title="Dead sensors and wrong mechanics",
        text=(
            "Dead sensors: wires that break when the rest is over, in random order. On a structure whose tendons "
            "are taut, the balance of forces stands in for them, and sigma grows as the error does. On a slack "
            "one there is nothing to stand in, and sigma does not tell.\n\n"
            f"![Node RMSE and median sigma against the number of dead sensors](../{FIGURE})\n\n"
            "Wrong mechanics, in all but the first and the last row: node RMSE in millimetres. `squeeze_01` and "
            "`slack_01` are simulated here from `examples/plans`, and are not the trials of these names above; they "
            "do not state their push-back, which is five times the default."
        ),
        command=f"python benchmarks/robustness.py --batch --figure {FIGURE}",
        make=wrong_mechanics,
        slow=True,
    ),
    Part(
        name="held-out",
        title="The sensor model on recordings held out",
        text="Errors of strain of the shipped model on recordings held out, of strips never seen.",
        command="python benchmarks/held_out.py",
        make=lambda inputs: held_out.held_out_table(),
    ),
    Part(
        name="trainings",
        title="Other trainings of the sensor model",
        text="The network with another seed, and beyond its training, where it is flagged and its sigma widened.",
        command="python benchmarks/held_out.py --train",
        make=lambda inputs: held_out.training_table(held_out.shipped_recordings(), TrainingSettings()),
        slow=True,
    ),
    Part(
        name="strips",
        title="Real strips",
        text=(
            "The nine recordings of "
            "[richgumy/electromech-stretcher](https://github.com/richgumy/electromech-stretcher) (carbon black in "
            "silicone): a model a file, its first 60 % train, its last 40 % test; then one model of every other "
            "file of a mix. RMSE in per cent of strain, the least in bold; another seed of the training can "
            "exchange neighbours."
        ),
        command="python benchmarks/real_strips.py FOLDER",
        make=lambda inputs: real_strips.table(inputs.strips, real_strips.RIG, TrainingSettings()),
    ),
    Part(
        name="worlds",
        title="The twin's sensors with other constants",
        text="RMSE of lengths on the plan `press`, in millimetres; the motion is the same in all.",
        command="python benchmarks/sensor_worlds.py",
        make=lambda inputs: sensor_worlds.table(sensor_worlds.PLAN.read_text()),
    ),
    Part(
        name="growth",
        title="Time and memory by the number of struts",
        text=(
            f"Towers of three-strut prisms whose tendons are all measured, {growth.FRAMES} frames: CPU time of a frame "
            "from lengths to shape and covariance, and memory of the whole estimate. The rods of such a tower share "
            "nodes, so that their forces depend on all of its shape: from some 24 struts on, time grows with their "
            "square.\n\n"
            f"![CPU time of a frame against the number of struts](figures/{GROWTH_FIGURE.name})"
        ),
        command=f"python benchmarks/growth.py --figure {GROWTH_FIGURE}",
        make=lambda inputs: growth_by_struts(),
    ),
    Part(
        name="time",
        title="Time",
        text="Of the first trial, and of processes that only import something.",
        command="python benchmarks/timing.py TRIAL",
        make=lambda inputs: [*timing.frame_table(inputs.trials[0]), "", *timing.import_table()],
    ),
]


def source() -> str:
    """Return eight digits that stand for the code and the sensor model that tables are made by."""
    paths = [*ROOT.glob("*.py"), *(path for room in PACKAGE for path in (ROOT / room).rglob("*.py"))]
    digest = sha256()
    for path in sorted([*paths, *(ROOT / "models" / "data").glob("*.safetensors")]):
        digest.update(path.relative_to(ROOT).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]


def section(part: Part, inputs: Inputs, made_by: str) -> str:
    """Make one part of the page."""
    table = "\n".join(part.make(inputs))
    packages = ", ".join(f"{name} {number}" for name, number in versions().items())
    return f"## {part.title}\n\n{part.text}\n\n{table}\n\n`{part.command}`; {packages}, source {made_by}.\n"


def page(parts: dict[str, tuple[str, str]]) -> str:
    """Return the page from (source, text) of the parts that were made; of the others it has heading and command."""
    sections = []
    for part in PARTS:
        absent = f"## {part.title}\n\nNot measured in this run: `{part.command}`\n"
        made_by, text = parts.get(part.name, (NOT_MADE, absent))
        sections.append(f"<!-- part: {part.name}, source {made_by} -->\n{text}<!-- end of {part.name} -->\n")
    sources = {made_by for made_by, _ in parts.values()}
    warning = (
        "\nParts of this page were measured with different versions of the code: "
        "`source` under each table names the version.\n"
    )
    return "\n".join([START + (warning if len(sources) > 1 else ""), *sections])


def made_before(text: str) -> dict[str, tuple[str, str]]:
    """Return (source, text) of each part that was made, by its name, from the text of a page."""
    return {name: (made_by, body) for name, made_by, body in MARK.findall(text) if made_by != NOT_MADE}


def main(arguments: list[str]) -> None:
    """Make the parts asked for, and write the page after each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", nargs="+", type=Path, default=[ROOT / "examples" / "press_01"], metavar="DIR")
    parser.add_argument("--strips", type=Path, metavar="DIR", help="recordings of real strips")
    parser.add_argument("--slow", action="store_true", help="with the parts that take many minutes")
    parser.add_argument("--only", action="append", choices=[part.name for part in PARTS], help="may be repeated")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "benchmarks.md")
    options = parser.parse_args(arguments)
    inputs = Inputs(options.trials, options.strips)
    text = options.page.read_text(encoding="utf-8") if options.page.exists() else ""
    parts = made_before(text)
    made_by = source()
    for part in PARTS:
        asked = part.name in options.only if options.only else options.slow or not part.slow
        if asked and (part.name != "strips" or inputs.strips):
            print(part.title, flush=True)
            parts[part.name] = made_by, section(part, inputs, made_by)
            options.page.write_text(page(parts), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
