"""Two runs of `reconstruct`, and two of `calibrate`, that several tests look at; and packages beside ours."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from blank_figures import no_figures
from command_line import CALIBRATE, run, run_process
from installed import install_example


@pytest.fixture(scope="session")
def done(tmp_path_factory, example):
    """The README's command on the first four seconds of the example, batch and live; figures of the first are drawn."""
    folder = tmp_path_factory.mktemp("cli")
    (folder / "press").mkdir()
    for source in example.iterdir():
        lines = source.read_text().splitlines(keepends=True)
        (folder / "press" / source.name).write_text("".join(lines if source.suffix == ".toml" else lines[:201]))
    batch = run_process("reconstruct", "press", cwd=folder)
    with no_figures():
        live = run("reconstruct", "press", "--live", "--out", "live", cwd=folder)
    return folder, batch, live


@pytest.fixture(scope="session")
def rig_folder(tmp_path_factory):
    """Seven recordings of strips at one speed each, and one file that is none."""
    folder = tmp_path_factory.mktemp("rig")
    (folder / "strips").mkdir()
    rng = np.random.default_rng(5)
    for k, speed in enumerate((0.01, 0.01, 0.03, 0.03, 0.09, 0.09, 0.09)):
        t_s = np.arange(0, 40, 0.2)
        strain = np.abs((speed * t_s + 0.2) % 0.4 - 0.2)
        ohm = 1e6 * (1 + (1 + 0.02 * k) * 1.3 * strain + 1e-3 * rng.standard_normal(len(t_s)))
        rows = [f"{t:.2f},{e:.6f},{r:.0f}" for t, e, r in zip(t_s, strain, ohm, strict=True)]
        text = "\n".join(["# natural_resistance_ohm = 1000000", "t_s,strain,resistance_ohm", *rows, ""])
        (folder / "strips" / f"s{k}.csv").write_text(text)
    (folder / "strips" / "bad.csv").write_text("# natural_resistance_ohm = 1\nt_s,strain,resistance_ohm\n0,0,x\n")
    return folder


@pytest.fixture(scope="session")
def calibrated(rig_folder):
    """A quick calibration with its sweep, of two learning rates and two epochs each."""
    with mock.patch.multiple("tensegraph.commands.calibrate", SWEEP=(1e-3, 1e-1), SWEEP_EPOCHS=2):
        return run(*CALIBRATE, "m.safetensors", "--sweep", cwd=rig_folder)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A directory of installed packages, for this process and those that it starts; afterwards they are forgotten."""
    place = tmp_path / "site"
    place.mkdir()
    monkeypatch.syspath_prepend(place)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(place), *filter(None, [os.environ.get("PYTHONPATH")])]))
    yield place
    for module in place.glob("*.py"):
        sys.modules.pop(module.stem, None)


@pytest.fixture
def own_parts(site: Path) -> Path:
    """The example package, installed."""
    install_example(site)
    return site
