"""MuJoCo models read by MuJoCo itself, of today's version and of others."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ...models.values.errors import InputError, needs_extra, reason_of
from ...models.values.units import LARGEST
from ..input_files import check_regular, real_path

NOT_READ = ("option", "visual", "statistic")
"""Elements that say nothing of a structure. Their attributes change with MuJoCo's versions, and so may be unknown."""

MOST_COPIES = 500
"""Number of copies of one part above which a model is not read: MuJoCo takes seconds for a thousand, and hours for a
million, which a line of text can ask for."""
MOST_PIXELS = 3e7
"""Number of points of textures and height fields, the same: MuJoCo makes them, although a structure has none."""


@dataclass(frozen=True, slots=True, eq=False)
class MujocoModel:
    """A model in the pose in which it starts."""

    path: Path
    mujoco: Any
    """The package."""
    model: Any
    """MjModel."""
    data: Any
    """MjData."""

    def name(self, kind: str, number: int) -> str:
        """Return the kind of a part of the model with its name, or its number where it has none."""
        name = self.own_name(kind, number)
        return f"{kind} '{name}'" if name else f"{kind} {number}"

    def own_name(self, kind: str, number: int) -> str | None:
        """Return the name of a part, such as a site; None where it has none.

        Raises:
            InputError: for a name that is not in UTF-8.
        """
        try:
            kinds = self.mujoco.mjtObj
            name: str | None = self.mujoco.mj_id2name(self.model, getattr(kinds, f"mjOBJ_{kind.upper()}"), number)
        except UnicodeDecodeError as error:
            raise InputError(f"{self.path}: {kind} {number}: expected a name in UTF-8, got {error.object!r}") from error
        return name


def read_model(path: Path) -> MujocoModel:
    """Return the model that a file describes.

    Raises:
        InputError: for a model that MuJoCo cannot read or warns of, or with parts far from its origin.
    """
    with needs_extra("a MuJoCo model", "twin"):
        import mujoco
    _check_size(path)
    warnings: list[str] = []
    mujoco.set_mju_user_warning(warnings.append)  # MuJoCo itself writes them to the terminal and into a file
    try:
        model = _compiled(mujoco, path)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
    except ValueError as error:
        raise InputError(f"{path}: MuJoCo cannot read it: {' '.join(reason_of(error).split())}") from error
    finally:
        mujoco.set_mju_user_warning(None)
    if warnings:
        raise InputError(f"{path}: MuJoCo warns of it: {' '.join(warnings[0].split())}")
    found = MujocoModel(path, mujoco, model, data)
    _check_extent(found)
    return found


def _check_size(path: Path) -> None:
    """Raise InputError for more copies of a part than a structure has, for huge images, or for a pipe as a file.

    What is no XML, MuJoCo tells.
    """
    try:
        roots = {file: ElementTree.parse(file).getroot() for file in _files(path, path.parent, set())}
    except (OSError, ElementTree.ParseError, RecursionError, ValueError):
        return
    copies, points = 1.0, 0.0
    for root in roots.values():
        left = [(root, 1.0)]
        while left:
            element, outer = left.pop()
            inner = outer * _copies(element)
            copies = max(copies, inner)
            points += _points(element)
            left += [(part, inner) for part in element]
    if copies > MOST_COPIES:
        raise InputError(f"{path}: expected at most {MOST_COPIES} copies of a part, got {copies:g}")
    if points > MOST_PIXELS:
        raise InputError(f"{path}: expected textures and height fields of {MOST_PIXELS:g} points, got {points:g}")


def _copies(element: ElementTree.Element) -> float:
    """Return how many copies an element makes of what is in it: the product of its `count`, else 1."""
    return max(_product(element, "count"), 1.0)


def _points(element: ElementTree.Element) -> float:
    """Return the number of points of a texture or a height field; a texture is a cube unless its type is 2d."""
    width, height = _product(element, "width"), _product(element, "height")
    if element.tag == "texture" and element.get("type") != "2d":
        height = max(height, 6 * width)
    return width * height + _product(element, "nrow", "ncol")


def _product(element: ElementTree.Element, *names: str) -> float:
    """Return the product of all numbers in some attributes; 0 where one is missing or holds something else."""
    try:
        return prod(max(float(number), 1.0) for name in names for number in element.attrib[name].split())
    except (KeyError, ValueError):
        return 0.0


def _check_extent(found: MujocoModel) -> None:
    """Raise InputError for a part that is further from the origin than any laboratory is wide, or nowhere."""
    for kind, position_m in (("body", found.data.xpos), ("site", found.data.site_xpos)):
        distance_m = np.abs(position_m).max(axis=1, initial=0.0)
        if not (distance_m <= LARGEST["m"]).all():  # an infinite axis of a joint makes nan
            name = found.name(kind, int(np.argmax(distance_m)))
            raise InputError(
                f"{found.path}: {name}: expected to be within {LARGEST['m']:g} m of the origin, "
                f"got {distance_m.max():.3g} m away"
            )


def _compiled(mujoco: Any, path: Path) -> Any:
    """Return the MjModel of a file, without the elements that are not read if it cannot be read with them.

    Raises:
        ValueError: MuJoCo's, of the file as it is.
    """
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        try:
            files = {file: _without_settings(file) for file in _files(path, path.parent, set())}
            names = {file.name for file in files}
            if len(names) == len(files):  # MuJoCo takes files in memory by these names
                return mujoco.MjModel.from_xml_path(str(path), {file.name: text for file, text in files.items()})
        except (OSError, ElementTree.ParseError, RecursionError, ValueError):
            pass
        raise error


def _files(path: Path, folder: Path, seen: set[Path]) -> Iterator[Path]:
    """Yield a file and all that it includes, by paths from the folder of the model or from its own."""
    if real_path(path) in seen:
        return
    seen.add(real_path(path))
    yield path
    for include in ElementTree.parse(path).iter("include"):
        name = include.get("file", "")
        inner = next((base / name for base in (folder, path.parent) if (base / name).is_file()), folder / name)
        if inner.exists():
            check_regular(inner)
        yield from _files(inner, folder, seen)


def _without_settings(path: Path) -> bytes:
    """Return a file's text with the elements that are not read emptied; MuJoCo refuses a file without elements."""
    root = ElementTree.parse(path).getroot()
    for element in root:
        if element.tag in NOT_READ:
            element.clear()
    return ElementTree.tostring(root)
