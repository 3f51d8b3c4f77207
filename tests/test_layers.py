"""The rooms of the package: which may import which, at any depth of a file, and that a name means one thing.

Each check returns what breaks it, so that it runs on the package, where it finds nothing, and on small trees, where it
has to find something.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from import_graph import (
    classes,
    constants,
    cycle,
    import_graph,
    imported,
    inside,
    libraries_of,
    modules,
    room,
)

ROOT = Path(__file__).parents[1]
MOST_MODULES = 15
BASIS = {"models.values", "models.structure", "models.balance", "models.sensor"}
DESCRIBED = {"models.structure_description", "models.trial_tables", "models.trial_description", "models.own_factor"}
RUNNING = BASIS | DESCRIBED | {"models.pose", "models.settings", "models.estimation", "models.shape_network"}
"""What of models/ runs with every trial; sensors are calibrated, simulated and evaluated beside it."""

MODELS_MAY_IMPORT = {
    "models.values": set(),
    "models.structure": {"models.values"},
    "models.balance": {"models.values", "models.structure"},
    "models.sensor": {"models.values"},
    "models.pose": {"models.values", "models.structure"},
    "models.structure_description": BASIS,
    "models.trial_tables": BASIS | {"models.structure_description"},
    "models.trial_description": BASIS
    | {"models.pose", "models.structure_description", "models.trial_tables", "models.own_factor"},
    "models.own_factor": BASIS | {"models.plug_ins"},
    "models.estimation": BASIS,
    "models.shape_network": BASIS,
    "models.settings": BASIS | {"models.pose", "models.estimation"},
    "models.calibration": BASIS,
    "models.plug_ins": {"models.values"},
    "models.strain_front_end": BASIS,
    "models.told_lengths": BASIS,
    "models.told_readings": BASIS | {"models.trial_description"},
    "models.ready_structures": BASIS,
    "models.twin": RUNNING,
    "models.evaluation": RUNNING,
    "models.data": set(),
    "models.__init__": set(),
}
MAY_IMPORT = {
    "models": set(),
    "factors": {"models"},
    "estimator": {"models", "factors"},
    "io": {"models"},
    "pipeline": {"models", "factors", "estimator", "io"},
    "live": {"models", "factors", "estimator", "io", "pipeline"},
    "scoring": {"models", "factors", "estimator", "io", "pipeline"},
}
"""Commands and the other modules at the root see everything."""

ALONE = {
    "torch": {"models.calibration.training", "models.calibration.torch_network"},
    "mujoco": {"io.structures.mujoco_model", "models.twin.engine"},
    "yaml": {"io.structures.yaml_structure"},
    "filterpy": {"estimator.baselines"},
    "gtsam": {"factors", "estimator"},
    "matplotlib": {"io.figures", "plot"},
    "serial": {"io.boards"},
    "ezc3d": {"io.mocap.c3d_points"},
    "pandas": {"models.structure.labelled", "models.structure.reconstruction"},
    "pyarrow": {"io.exports"},
    "rerun": {"io.viewer"},
    "rosbags": {"io.exports", "io.length_files"},
    "xarray": {"models.structure.labelled", "models.structure.reconstruction"},
    "typer": {"cli"},
}
"""Libraries that are imported in these places and nowhere else."""

ONCE = ("filterpy",)
"""Libraries that one module imports: filterpy is there for the baseline alone."""

Check = Callable[[Path], Iterator[str]]


def back_arrows_between_folders(root: Path) -> Iterator[str]:
    """Models, factors, estimator, io, pipeline, live and scoring import along the arrows."""
    known = modules(root)
    for name, path in known.items():
        folder = name.split(".")[0]
        if folder in MAY_IMPORT:
            seen = {other.split(".")[0] for other in imported(path, root)}
            at_root = {other for other in known if "." not in other}
            folders = {*MAY_IMPORT, "commands"}
            for other in sorted(seen & (folders | at_root) - MAY_IMPORT[folder] - {folder}):
                yield f"{name} imports {other}"


def back_arrows_inside_models(root: Path) -> Iterator[str]:
    """Values, then structure and sensor, then what describes a trial, then twin and evaluation."""
    for name, others in import_graph(root).items():
        if inside(name, "models"):
            for other in sorted(others):
                if inside(other, "models") and room(other) not in MODELS_MAY_IMPORT.get(room(name), set()) | {
                    room(name)
                }:
                    yield f"{name} imports {other}"


def rooms_without_arrows(root: Path) -> Iterator[str]:
    """A new room of models/ stands in the table of arrows."""
    yield from sorted({room(name) for name in modules(root) if inside(name, "models")} - MODELS_MAY_IMPORT.keys())


def calibration_at_run_time(root: Path) -> Iterator[str]:
    """What runs with a trial needs nothing of what calibrated its sensors."""
    places = ("models", "factors", "estimator", "pipeline", "live")
    for name, path in modules(root).items():
        running = any(inside(name, place) for place in places) and not inside(name, "models.calibration")
        if running and any(inside(other, "models.calibration") for other in imported(path, root)):
            yield name


def evaluation_in_estimates(root: Path) -> Iterator[str]:
    """No estimator and no factor sees what compares it with the truth."""
    for name, path in modules(root).items():
        estimates = inside(name, "estimator") or inside(name, "factors")
        if estimates and any(inside(other, "models.evaluation") for other in imported(path, root)):
            yield name


def libraries_elsewhere(root: Path) -> Iterator[str]:
    """Heavy libraries are imported in the places that need them."""
    for name, path in modules(root).items():
        for library in sorted(libraries_of(path, root) & ALONE.keys()):
            if not any(inside(name, place) for place in ALONE[library]):
                yield f"{name} imports {library}"


def libraries_of_several_modules(root: Path) -> Iterator[str]:
    """Some libraries are imported by one module."""
    for library in ONCE:
        found = [name for name, path in modules(root).items() if library in libraries_of(path, root)]
        if len(found) > 1:
            yield f"{library}: {', '.join(found)}"


def circles(root: Path) -> Iterator[str]:
    """No module imports itself by way of others."""
    if found := cycle(import_graph(root)):
        yield " -> ".join(found)


def shared(names_of: Callable[[Path], set[str]], root: Path) -> Iterator[str]:
    """Yield the names that several modules define."""
    where = defaultdict(list)
    for module, path in modules(root).items():
        for name in names_of(path):
            where[name].append(module)
    for name, found in sorted(where.items()):
        if len(found) > 1:
            yield f"{name}: {', '.join(found)}"


def modules_of_one_name(root: Path) -> Iterator[str]:
    """No two modules have one base name, but for the packages' own."""
    return shared(lambda path: {path.stem} - {"__init__"}, root)


def classes_of_one_name(root: Path) -> Iterator[str]:
    """No two classes have one name."""
    return shared(classes, root)


def constants_defined_twice(root: Path) -> Iterator[str]:
    """A constant is defined in one place."""
    return shared(constants, root)


def crowded_rooms(root: Path) -> Iterator[str]:
    """A folder holds no more modules than one can look over."""
    count = defaultdict(int)
    for path in modules(root).values():
        count[path.parent] += path.name != "__init__.py"
    for folder, number in count.items():
        if number > MOST_MODULES:
            yield f"{folder.relative_to(root).as_posix()}: {number} modules"


CHECKS: list[Check] = [
    back_arrows_between_folders,
    back_arrows_inside_models,
    rooms_without_arrows,
    calibration_at_run_time,
    evaluation_in_estimates,
    libraries_elsewhere,
    libraries_of_several_modules,
    circles,
    modules_of_one_name,
    classes_of_one_name,
    constants_defined_twice,
    crowded_rooms,
]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_package_keeps(check: Check) -> None:
    assert list(check(ROOT)) == [], check.__doc__


def test_every_module_is_looked_at() -> None:
    """The table of rooms is the tree, and the checks see all of it."""
    seen = {path.relative_to(ROOT).parts[0] for path in modules(ROOT).values()}
    assert seen >= {*MAY_IMPORT, "commands", "pipeline.py", "cli.py"} - {"pipeline"}
    assert {room(name) for name in modules(ROOT) if inside(name, "models")} == MODELS_MAY_IMPORT.keys()
    for library, places in ALONE.items():
        for place in places:
            found = [path for name, path in modules(ROOT).items() if inside(name, place)]
            assert any(library in libraries_of(path, ROOT) for path in found), (library, place)


def test_io_has_no_init() -> None:
    """`io/__init__.py` would hide the standard library's io from mypy, `PYTHONPATH=.` and debuggers."""
    assert not (ROOT / "io" / "__init__.py").exists()


def written(root: Path, files: dict[str, str]) -> Path:
    """Make a small tree of files."""
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


@pytest.mark.parametrize(
    "line",
    [
        "from ..io.trial import Trial",
        "from .. import io",
        "from tensegraph.io import trial",
        "import tensegraph.io.trial",
        "def f():\n    from ..io import csv",
        "from ..pipeline import stream",
        "from .. import pipeline",
        "from ..live import session",
    ],
)
def test_a_back_arrow_is_seen(tmp_path: Path, line: str) -> None:
    root = written(tmp_path, {"models/new.py": line, "pipeline.py": ""})
    assert len(list(back_arrows_between_folders(root))) == 1


FAULTY: list[tuple[Check, dict[str, str]]] = [
    (back_arrows_between_folders, {"factors/rod.py": "from ..estimator import frame"}),
    (back_arrows_between_folders, {"io/boards/port.py": "from ...estimator.frame import FrameEstimator"}),
    (back_arrows_inside_models, {"models/values/a.py": "from ..sensor.b import B", "models/sensor/b.py": ""}),
    (back_arrows_inside_models, {"models/sensor/a.py": "from ..structure.b import B", "models/structure/b.py": ""}),
    (back_arrows_inside_models, {"models/sensor/a.py": "from ..settings import B", "models/settings.py": ""}),
    (back_arrows_inside_models, {"models/settings.py": "from .twin.b import B", "models/twin/b.py": ""}),
    (back_arrows_inside_models, {"models/twin/a.py": "from ..evaluation import b", "models/evaluation/b.py": ""}),
    (rooms_without_arrows, {"models/cellar/a.py": ""}),
    (calibration_at_run_time, {"pipeline.py": "from .models.calibration.strips import Strip"}),
    (calibration_at_run_time, {"models/sensor/a.py": "def f():\n    from ..calibration import strips"}),
    (calibration_at_run_time, {"live/a.py": "from ..models import calibration"}),
    (evaluation_in_estimates, {"estimator/a.py": "from ..models.evaluation.truth import Truth"}),
    (evaluation_in_estimates, {"factors/a.py": "from ..models import evaluation"}),
    (libraries_elsewhere, {"models/sensor/lstm.py": "def f():\n    import torch.nn"}),
    (libraries_elsewhere, {"commands/a.py": "from mujoco import MjModel"}),
    (libraries_elsewhere, {"commands/a.py": "from filterpy.kalman import UnscentedKalmanFilter"}),
    (libraries_elsewhere, {"io/a.py": "import gtsam"}),
    (libraries_of_several_modules, {"estimator/a.py": "import filterpy", "estimator/b.py": "import filterpy.kalman"}),
    (circles, {"models/a.py": "from .b import B", "models/b.py": "from . import a"}),
    (
        circles,
        {
            "models/sensor/a.py": "from .b import B",
            "models/sensor/b.py": "def f():\n    from ..values.c import C",
            "models/values/c.py": "import tensegraph.models.sensor.a",
        },
    ),
    (modules_of_one_name, {"io/boards/trial.py": "", "commands/trial.py": ""}),
    (classes_of_one_name, {"io/a.py": "class Score: ...", "models/twin/b.py": "class Score: ..."}),
    (constants_defined_twice, {"io/a.py": "LIMIT_M = 1.0", "models/b.py": "LIMIT_M: float = 1.0"}),
    (constants_defined_twice, {"io/a.py": "LEFT, RIGHT = 0, 1", "models/b.py": "RIGHT = 1"}),
    (crowded_rooms, {f"io/boards/m{k}.py": "" for k in range(16)}),
]


@pytest.mark.parametrize(
    ("check", "files"), FAULTY, ids=[f"{check.__name__}-{next(iter(files))}" for check, files in FAULTY]
)
def test_each_check_can_fail(tmp_path: Path, check: Check, files: dict[str, str]) -> None:
    assert len(list(check(written(tmp_path, files)))) == 1


def test_each_check_has_a_tree_that_breaks_it() -> None:
    assert {check for check, _ in FAULTY} == set(CHECKS)


def test_a_sound_tree_passes_all(tmp_path: Path) -> None:
    files = {
        "models/values/a.py": "A_M = 1.0\nclass A: ...",
        "models/sensor/b.py": "from ..values.a import A, A_M\nclass B: ...",
        "models/settings.py": "from .sensor.b import B",
        "models/calibration/training.py": "import torch\nfrom ..sensor.b import B",
        "models/evaluation/d.py": "from ..settings import B",
        "factors/e.py": "import gtsam\nfrom ..models.settings import B",
        "estimator/f.py": "from ..factors.e import gtsam",
        "io/g.py": "from ..models.evaluation import d",
        "pipeline.py": "from .estimator.f import gtsam\nfrom .io import g",
        "live/h.py": "from ..pipeline import g",
        "commands/i.py": "from ..models.calibration.training import B",
    }
    root = written(tmp_path, files)
    assert [line for check in CHECKS for line in check(root)] == []
