"""Hostile files: each run ends with a sane result, or with one line and exit code 2, within its time and memory."""

import os
import random
import shutil
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import hostile_runs
import mutations
import slip_mutations
import tensegraph.cli
from hostile_runs import Ground, attack, quick_start
from hostile_targets import TARGETS, Target, press
from sane_results import insane
from tensegraph import Reconstruction, open_trial, save, stream

EXAMPLES = Path(__file__).parents[2] / "examples"
QUICK_RUNS = 14


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    with quick_start():
        yield


@pytest.fixture(scope="session")
def grounds(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Ground]:
    folder = tmp_path_factory.mktemp("grounds")
    return lambda name: Ground.made(name, TARGETS[name], folder)


@pytest.mark.parametrize("name", [name for name, target in TARGETS.items() if not target.slow])
def test_a_hostile_file_is_refused_in_one_line_or_read_sanely(grounds, tmp_path: Path, name: str) -> None:
    ground = grounds(name)
    assert not list(attack([(ground, seed) for seed in range(QUICK_RUNS)], tmp_path))


@pytest.mark.long
@pytest.mark.parametrize("name", TARGETS)
def test_hostile_files_for_hours(grounds, tmp_path: Path, name: str) -> None:
    until = int(os.environ.get("TENSEGRAPH_FUZZ_UNTIL", 2000))
    seeds = range(1000, until, 10 if TARGETS[name].slow else 1)
    ground = grounds(name)
    assert not list(attack([(ground, seed) for seed in seeds], tmp_path))


@pytest.mark.parametrize("change", [mutations.mutate, slip_mutations.slip])
@pytest.mark.parametrize("name", ["trial.toml", "board0.csv"])
def test_the_mutations_change_the_file(tmp_path: Path, change: Callable[..., str], name: str) -> None:
    """Most seeds give another file; none fails by itself."""
    before = (EXAMPLES / "press_01" / name).read_bytes()[:5000]
    changed = 0
    for seed in range(100):
        copy = tmp_path / name
        copy.write_bytes(before)
        change(copy, random.Random(seed))
        changed += copy.read_bytes() != before
    assert changed > 80


def endless() -> None:
    while True:
        pass


@pytest.mark.parametrize(
    ("main", "said"),
    [
        (lambda: 1 / 0, "code 99: Traceback"),
        (lambda: sys.exit("two\nlines"), "code 1"),
        (lambda: sys.exit(1), "code 1"),
        (lambda: warnings.warn("odd", RuntimeWarning, stacklevel=1), "a warning: "),
        (lambda: print("tensegraph: a\tb", file=sys.stderr) or sys.exit(2), "no line to read"),
        (endless, "ended by signal SIGPROF"),
        (lambda: os.kill(os.getpid(), 9), "ended by signal SIGKILL"),
        (lambda: print("tensegraph: no", file=sys.stderr) or sys.exit(2), None),
    ],
)
def test_the_harness_sees_what_is_wrong(monkeypatch, tmp_path: Path, main, said: str | None) -> None:
    """Of two runs, the one after another that kills the process is done, too."""
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "a.csv").write_text("t_s\n1\n")
    monkeypatch.setattr(tensegraph.cli, "main", main)
    monkeypatch.setattr(hostile_runs, "CPU_S", 0.2)
    ground = Ground("a", Target(press, (), ("a.csv",)), tmp_path / "files")
    found = list(attack([(ground, 1), (ground, 2)], tmp_path))
    assert len(found) == (2 if said else 0)
    assert all(said in wrong for wrong in found)


@pytest.mark.parametrize(
    ("name", "column", "cell", "said"),
    [
        ("shape.csv", "n5_x_m", "nan", "shape.csv: n5_x_m is not finite"),
        ("shape.csv", "n5_x_m", "0.9", "ok with a rod"),
        ("status.csv", "mechanism_sigma_m", "inf", "status.csv: mechanism_sigma_m is not finite"),
        ("ellipsoids.csv", "cxx_m2", "-1.0", "expected a covariance"),
        ("lengths.csv", "length_m", "nan", None),
    ],
)
def test_an_insane_result_is_seen(saved: Path, tmp_path: Path, name: str, column: str, cell: str, said) -> None:
    shutil.copytree(saved, tmp_path / "out")
    header, first, *rows = (tmp_path / "out" / name).read_text().splitlines()
    cells = first.split(",")
    cells[header.split(",").index(column)] = cell
    (tmp_path / "out" / name).write_text("\n".join([header, ",".join(cells), *rows, ""]))
    if said == "ok with a rod":  # an ellipsoid is about its node
        table = tmp_path / "out" / "ellipsoids.csv"
        rows = table.read_text().splitlines()
        rows[6] = ",".join([*rows[6].split(",")[:2], cell, *rows[6].split(",")[3:]])
        table.write_text("\n".join([*rows, ""]))
    wrong = insane(tmp_path)
    assert (said in wrong) if said else wrong is None


@pytest.fixture(scope="module")
def saved(example: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty frames of the example, live."""
    trial, folder = open_trial(example), tmp_path_factory.mktemp("sane") / "run"
    readings = (row for row in trial.readings() if row.host_s < 0.4)
    save(Reconstruction.of(trial.description.structure, stream(readings, trial.description)), folder, figures=None)
    return folder
