"""The package's modules and who imports whom, read from the source: for `test_layers.py`."""

import ast
from functools import cache
from pathlib import Path

ROOMS = ("commands", "estimator", "factors", "io", "live", "models", "scoring")
"""Folders of the repository that are the package; beside them only the modules at its root."""


def module_name(path: Path, root: Path) -> str:
    """Return a file's dotted name below the package."""
    return ".".join(path.relative_to(root).with_suffix("").parts)


def modules(root: Path) -> dict[str, Path]:
    """Return the package's files by dotted name."""
    paths = [*root.glob("*.py"), *(path for room in ROOMS for path in (root / room).rglob("*.py"))]
    return {module_name(path, root): path for path in sorted(paths)}


def room(name: str) -> str:
    """Return where a module is: a folder or a module of models/, or else a folder or a module at the root."""
    first, *rest = name.split(".")
    return f"models.{rest[0]}" if first == "models" and rest else first


def inside(name: str, place: str) -> bool:
    """Return whether a module is a place, or lies in it."""
    return f"{name}.".startswith(f"{place}.")


@cache
def import_statements(source: str) -> tuple[ast.Import | ast.ImportFrom, ...]:
    """Return the import statements of a source, wherever in it; each of many checks asks for those of every file."""
    return tuple(node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Import | ast.ImportFrom))


def names_imported(path: Path, root: Path) -> set[str]:
    """Return every dotted name that a file imports, wherever in it, relative names made absolute."""
    package = ["tensegraph", *path.relative_to(root).parent.parts]
    found = set()
    for node in import_statements(path.read_text()):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        else:
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return found


def imported(path: Path, root: Path) -> set[str]:
    """Return the dotted names below the package that a file imports."""
    return {name.removeprefix("tensegraph.") for name in names_imported(path, root) if name.startswith("tensegraph.")}


def libraries_of(path: Path, root: Path) -> set[str]:
    """Return the first part of every name that a file imports."""
    return {name.split(".")[0] for name in names_imported(path, root)}


def import_graph(root: Path) -> dict[str, set[str]]:
    """Return for each module the modules that it imports."""
    found = modules(root)
    return {name: (imported(path, root) & found.keys()) - {name} for name, path in found.items()}


def cycle(graph: dict[str, set[str]]) -> list[str]:
    """Return the modules of a circle of imports, or none."""
    left = {name: set(others) for name, others in graph.items()}
    while free := [name for name, others in left.items() if not others & left.keys()]:
        for name in free:
            del left[name]
    if not left:
        return []
    path = [min(left)]  # each of these imports another of these, so that the way comes back to itself
    while path[-1] not in path[:-1]:
        path.append(min(left[path[-1]] & left.keys()))
    return path[path.index(path[-1]) :]


def classes(path: Path) -> set[str]:
    """Return the classes at a file's top level."""
    return {node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.ClassDef)}


def constants(path: Path) -> set[str]:
    """Return the names in capitals that a file assigns at its top level."""
    found = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)}
    return {name for name in found if name.isupper() and len(name) > 1}
