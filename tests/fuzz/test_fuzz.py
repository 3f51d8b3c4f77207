"""Hostile files: each run ends with a sane result, or with one line and exit code 2, within its time and memory."""

import os
import random
import resource
import shutil
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import tensegraph.cli
from mutations import mutate

EXAMPLES = Path(__file__).parents[2] / "examples"
SHIPPED_MODEL = EXAMPLES.parent / "models" / "data" / "stretching.safetensors"
CPU_S = 25
MEMORY_BYTES = 12 << 30
FARTHEST_M = 3.0
"""Distance from the first node to another, ten rods long, that no shape of the examples has."""


def cut(source: Path, target: Path, until_s: float) -> Path:
    """Copy a trial without its readings after a time."""
    target.mkdir()
    for file in source.iterdir():
        if file.suffix == ".toml":
            shutil.copy(file, target)
        if file.suffix == ".csv":
            header, *rows = file.read_text().splitlines(keepends=True)
            (target / file.name).write_text(header + "".join(r for r in rows if float(r.split(",")[0]) < until_s))
    return target


def with_config(trial: Path) -> Path:
    shutil.copy(SHIPPED_MODEL, trial / "model.safetensors")
    (trial / "config.toml").write_text("[frames]\nrate_hz = 50.0\n[noise]\nforce_n = 0.1\n[smoother]\nlag = 5\n")
    return trial


MAKE: dict[str, Callable[[Path], Path]] = {
    "press": lambda target: with_config(cut(EXAMPLES / "press_01", target, 2.6)),
    "roll": lambda target: with_config(cut(EXAMPLES / "roll_02", target, 2.6)),
}
FILES = ("trial.toml", "trial.toml", "board0.csv", "truth.csv", "config.toml", "imu0.csv", "model.safetensors")


@pytest.fixture(scope="module", params=MAKE)
def trial(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return MAKE[request.param](tmp_path_factory.mktemp("hostile") / request.param)


def outcome(directory: Path) -> str | None:
    """Run `reconstruct` in a process of its own, and return what is wrong with how it ended, or None."""
    out, error = directory / "out", directory / "error.txt"
    child = os.fork()
    if child == 0:
        _reconstruct(directory, out, error)
    _, status = os.waitpid(child, 0)
    text = error.read_text(errors="replace")
    if os.WIFSIGNALED(status):
        return f"ended by signal {os.WTERMSIG(status)}"
    if os.WEXITSTATUS(status) == 0:
        return f"a warning: {text}" if "Warning" in text else insane(out)
    if os.WEXITSTATUS(status) != 2 or len(text.strip().splitlines()) != 1 or not text.startswith("tensegraph: "):
        return f"code {os.WEXITSTATUS(status)}: {text}"
    return "a result beside an error" if out.exists() else None


def _reconstruct(directory: Path, out: Path, error: Path) -> None:
    """Run the command in this process, and end it; a hang or a leak ends it, too."""
    code = 0
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(os.open(error, os.O_CREAT | os.O_WRONLY), 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S + 1))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        options = ["--config", str(directory / "config.toml"), "--model", str(directory / "model.safetensors")]
        sys.argv = [
            "tensegraph",
            "reconstruct",
            str(directory),
            "--out",
            str(out),
            "--figures",
            "none",
            "--live",
            *options,
        ]
        try:
            tensegraph.cli.main()
        except SystemExit as ended:
            code = int(ended.code or 0)
        except BaseException:
            traceback.print_exc()
            code = 99
        sys.stderr.flush()
    finally:
        os._exit(code)


def insane(result: Path) -> str | None:
    """Return what no robot of the examples can have done, or None."""
    rows = np.genfromtxt(result / "shape.csv", delimiter=",", skip_header=1, ndmin=2)
    status = [line.split(",")[1] for line in (result / "status.csv").read_text().splitlines()[1:]]
    if not np.isfinite(rows).all() or len(rows) != len(status):
        return "shape.csv is not finite"
    if (np.diff(rows[:, 0]) <= 0).any():
        return "times go back"
    nodes = rows[:, 1:].reshape(len(rows), -1, 3)
    if np.linalg.norm(nodes - nodes[:, :1], axis=-1).max() > FARTHEST_M:
        return f"a shape of {np.ptp(nodes):.3g} m"
    ellipsoids = (result / "ellipsoids.csv").read_text()
    return "ellipsoids.csv is not finite" if "nan" in ellipsoids or "inf" in ellipsoids else None


def attack(trial: Path, directory: Path, seed: int) -> None:
    rng = random.Random(f"{trial.name} {seed}")
    target = directory / f"{trial.name}_{seed}"
    shutil.copytree(trial, target)
    change = mutate(target / rng.choice([name for name in FILES if (trial / name).exists()]), rng)
    wrong = outcome(target)
    assert wrong is None, f"{trial.name}, seed {seed}: {change}: {wrong}"
    shutil.rmtree(target)


@pytest.mark.parametrize("seed", range(8))
def test_a_hostile_file_is_refused_in_one_line_or_estimated_sanely(trial: Path, tmp_path: Path, seed: int) -> None:
    attack(trial, tmp_path, seed)


@pytest.mark.long
def test_hostile_files_for_hours(trial: Path, tmp_path: Path) -> None:
    for seed in range(1000, int(os.environ.get("TENSEGRAPH_FUZZ_UNTIL", 2000))):
        attack(trial, tmp_path, seed)


def test_the_mutations_change_the_file(trial: Path, tmp_path: Path) -> None:
    """Most seeds give another file; none fails by itself."""
    before = (trial / "trial.toml").read_bytes()
    changed = 0
    for seed in range(50):
        copy = tmp_path / "trial.toml"
        copy.write_bytes(before)
        mutate(copy, random.Random(seed))
        changed += copy.read_bytes() != before
    assert changed > 40
