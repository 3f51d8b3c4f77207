"""What importing costs: heavy libraries are loaded by what needs them, and by nothing else."""

import subprocess
import sys

HEAVY = {
    *("matplotlib", "filterpy", "torch", "rich", "typer", "mujoco", "serial", "pandas", "xarray", "pyarrow", "ezc3d"),
    *("scipy.stats", "scipy.signal"),  # a third of the time of all the rest that an estimate imports
}


def loaded(statements: str) -> set[str]:
    """Return the modules of a process that has run some statements, those within packages by their dotted names."""
    command = [sys.executable, "-c", f"import sys\n{statements}\nprint(*sys.modules, sep='\\n')"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    return set(done.stdout.splitlines())


def test_the_package_loads_nothing_heavy() -> None:
    assert not loaded("import tensegraph") & (HEAVY | {"scipy", "gtsam", "pydantic", "safetensors"})


def test_the_public_names_load_nothing_heavy() -> None:
    """All that an estimate without figures needs."""
    names = loaded("import tensegraph\nfor name in dir(tensegraph): getattr(tensegraph, name)")
    assert "gtsam" in names
    assert not names & HEAVY


def test_help_loads_no_work() -> None:
    """All of these, one after another, load nothing of it."""
    asked = [["--help"], ["reconstruct", "--help"], ["live", "-h"], ["--version"]]
    run = f"from tensegraph.cli import app\nfor words in {asked}: app(words, standalone_mode=False)"
    assert not loaded(run) & {"numpy", "gtsam", "scipy", "matplotlib", "torch"}  # typer itself may load pydantic


def test_a_recording_loads_no_matplotlib() -> None:
    assert "matplotlib" not in loaded("import tensegraph.commands.record")


def test_filterpy_is_loaded_when_it_is_chosen() -> None:
    choose = (
        "import numpy as np\n"
        "from tensegraph import Settings, three_strut\n"
        "from tensegraph.models.structure.rest_shape import RestShape\n"
        "from tensegraph.pipeline import ESTIMATORS\n"
        "structure = three_strut(0.3, 0.18)\n"
        "rest = RestShape(structure, np.zeros((6, 3)), np.zeros((18, 18)), 'measured')\n"
        "ESTIMATORS['least-squares'](structure, rest, Settings())\n"
        "assert 'filterpy' not in sys.modules\n"
        "ESTIMATORS['ukf'](structure, rest, Settings())"
    )
    assert "filterpy" in loaded(choose)
