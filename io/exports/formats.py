"""The formats that runs are exported to, and their files."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ...models.plug_ins import PlugIn, errors_of_plug_in, plug_ins
from ...models.structure.labelled import TABLES
from ...models.structure.reconstruction import Reconstruction
from ...models.values.errors import InputError, printable
from ..whole import check_writable, written_whole

SUFFIXES = {
    "mat": ".mat",
    "npz": ".npz",
    "netcdf": ".nc",
    "parquet": ".parquet",
    "ply": ".ply",
    "gltf": ".glb",
    "ros2": ".mcap",
    "rerun": ".rrd",
    "mp4": ".mp4",
    "gif": ".gif",
}
"""How the file of each format ends."""
OF_ONE_FRAME = ("ply", "gltf")
Exporter = Callable[[Reconstruction, Mapping[str, Any], Path], None]
"""What another package writes a run with: a function of the run, of what is told of it, which are texts and numbers by
name, and of the path of the file to write. The name of its entry point, of the group `tensegraph.exporters`, is that of
the format, and the suffix of its files without the dot."""


def exporter_plug_ins() -> dict[str, PlugIn]:
    """Return the formats that other packages write, by name.

    Raises:
        InputError: when two packages bring one.
    """
    return plug_ins("exporters", {*SUFFIXES, *(suffix.removeprefix(".") for suffix in SUFFIXES.values())})


def all_suffixes() -> dict[str, str]:
    """Return how the file of each format ends, of those of other packages too."""
    return SUFFIXES | {name: f".{name}" for name in exporter_plug_ins()}


def export(
    result: Reconstruction,
    path: str | Path,
    *,
    at_s: float | None = None,
    probability: float = 0.95,
    about: Mapping[str, str] | None = None,
) -> list[Path]:
    """Write a run in the format that the suffix of a path names, completely or not at all.

    Args:
        result: the run.
        path: of the file, whose suffix is one of `all_suffixes`; an earlier file is replaced. Parquet is three files,
            `NAME.frames.parquet`, `NAME.nodes.parquet` and `NAME.tendons.parquet`.
        at_s: time of the frame, for the formats of one frame (.ply, .glb).
        probability: of the ellipsoids.
        about: further attributes, such as the name of the trial.

    Returns:
        The paths of the files.

    Raises:
        InputError: for another suffix, a time that is missing or too many, a library that is not installed, or a path
            that cannot be written.
    """
    path = Path(path)
    format_name = format_of(path)
    paths = paths_of(path, format_name)
    for place in paths:
        check_file(place)
    attributes = {name: printable(text) for name, text in (about or {}).items()}
    told = {**attributes, "coordinate_frame": result.coordinate_frame, "probability": probability}
    with written_whole(*paths) as inside:
        if format_name in OF_ONE_FRAME:
            _write_frame(result, format_name, at_s, probability, told, inside[0])
        elif at_s is not None:
            raise InputError(f"at {at_s:g} s: {path.suffix} holds all frames: expected no time")
        else:
            _write_run(result, format_name, probability, told, inside)
    return paths


def format_of(path: Path) -> str:
    """Return the format that the suffix of a path names.

    Raises:
        InputError: when there is none.
    """
    known = all_suffixes()
    for name, suffix in known.items():
        if path.suffix == suffix:
            return name
    raise InputError(f"{path}: expected a name that ends in {', '.join(known.values())}")


def paths_of(path: Path, format_name: str) -> list[Path]:
    """Return the paths of the files that are written."""
    if format_name == "parquet":
        return [path.with_suffix(f".{table}{path.suffix}") for table in TABLES]
    return [path]


def check_file(path: Path) -> None:
    """Check, before any work, that a file can be written to a path.

    Raises:
        InputError: when it is a directory, or its directory cannot be written to.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a directory: expected the name of a file")
    check_writable(path)


def _write_run(
    result: Reconstruction, format_name: str, probability: float, about: dict[str, Any], paths: tuple[Path, ...]
) -> None:
    """Write all frames; the modules of a format, and what they import, are imported where it is chosen."""
    if format_name in ("mp4", "gif"):
        from ..figures.film import write_film

        write_film(result, probability, paths[0])
    elif format_name == "ros2":
        from .ros2_file import write_ros2

        write_ros2(result, probability, paths[0])
    elif format_name == "rerun":
        from .rerun_file import write_rerun

        write_rerun(result, probability, paths[0])
    elif format_name == "parquet":
        from .parquet_files import write_parquet

        arrays = result.arrays(probability)
        for table, path in zip(TABLES, paths, strict=True):
            write_parquet(arrays, table, about, path)
    elif format_name not in SUFFIXES:
        _write_by(exporter_plug_ins()[format_name], result, about, paths[0])
    else:
        from .array_files import write_mat, write_netcdf, write_npz

        {"mat": write_mat, "npz": write_npz, "netcdf": write_netcdf}[format_name](
            result.arrays(probability), about, paths[0]
        )


def _write_by(plug_in: PlugIn, result: Reconstruction, about: dict[str, Any], path: Path) -> None:
    """Write all frames with an exporter of another package.

    Raises:
        InputError: when it cannot be imported, raises anything, or writes no file.
    """
    write: Exporter = plug_in.load()
    with errors_of_plug_in(lambda: f"{path.name}: {plug_in} cannot write it"):
        write(result, about, path)
    if not path.is_file():
        raise InputError(f"{plug_in}: has written no file")


def _write_frame(
    result: Reconstruction, format_name: str, at_s: float | None, probability: float, about: dict[str, Any], path: Path
) -> None:
    """Write the frame nearest to a time."""
    from .mesh_files import write_gltf, write_ply  # matplotlib, whose colours these files have too
    from .solids import solids_of

    first_s, last_s = result.t_s[[0, -1]]
    if at_s is None or not first_s <= at_s <= last_s:
        expected = f"expected its time, --at or at_s, from {first_s:.2f} to {last_s:.2f} s"
        raise InputError(f"{path.name}: holds one frame: {expected}" + ("" if at_s is None else f", got {at_s:g}"))
    shape = result[at_s]
    solids = list(solids_of(result.structure, shape, probability))
    told = {**about, "t_s": float(shape.t_s), "status": str(shape.status)}
    {"ply": write_ply, "gltf": write_gltf}[format_name](solids, told, path)
