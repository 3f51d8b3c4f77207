"""The arrows between folders: imports never flow back, at any depth of a file, relative or absolute."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {"models": set(), "factors": {"models"}, "estimator": {"models", "factors"}, "io": {"models"}}
FOLDERS = set(MAY_IMPORT)


def imported(path: Path, root: Path = ROOT) -> set[str]:
    """Return the dotted names below tensegraph that a file imports."""
    package = ["tensegraph", *path.relative_to(root).parent.parts]
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return {name.removeprefix("tensegraph.") for name in found if name.startswith("tensegraph.")}


def folders_imported(path: Path, root: Path = ROOT) -> set[str]:
    return {name.split(".")[0] for name in imported(path, root)} & FOLDERS


def root_modules_imported(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imported(path)} & {p.stem for p in ROOT.glob("*.py")}


@pytest.mark.parametrize("folder", sorted(MAY_IMPORT))
def test_imports_follow_the_arrows(folder: str) -> None:
    for path in (ROOT / folder).rglob("*.py"):
        assert folders_imported(path) <= MAY_IMPORT[folder] | {folder}, path
        assert not root_modules_imported(path), path


def test_only_the_root_sees_truth() -> None:
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*.py"):
            names = imported(path)
            assert not any(name.startswith("estimator.evaluation") for name in names), path
            if folder in ("factors", "estimator") and path.name != "evaluation.py":
                assert not any(name.startswith("models.evaluation") for name in names), path


def test_io_has_no_init() -> None:
    """`io/__init__.py` would hide the standard library's io from mypy, `PYTHONPATH=.` and debuggers."""
    assert not (ROOT / "io" / "__init__.py").exists()


def test_torch_is_imported_for_training_alone() -> None:
    for folder in [*FOLDERS, "."]:
        for path in (ROOT / folder).glob("*.py"):
            text = path.read_text()
            assert ("import torch" in text) == (path.name == "training.py"), path


def test_mujoco_is_imported_by_the_twin_alone() -> None:
    for folder in [*FOLDERS, "."]:
        for path in (ROOT / folder).glob("*.py"):
            assert ("import mujoco" in path.read_text()) == (path.name == "twin.py"), path


@pytest.mark.parametrize(
    "line",
    [
        "from ..io.trial import Trial",
        "from .. import io",
        "from tensegraph.io import trial",
        "import tensegraph.io.trial",
        "def f():\n    from ..io import csv",
    ],
)
def test_a_back_arrow_is_seen(tmp_path: Path, line: str) -> None:
    (tmp_path / "models").mkdir()
    path = tmp_path / "models" / "new.py"
    path.write_text(line)
    assert "io" in folders_imported(path, tmp_path)
