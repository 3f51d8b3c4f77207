"""Results on disk: a directory of CSV files that is there whole or not at all."""

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from scipy.spatial.transform import Rotation

from ..models.errors import InputError
from ..models.readings import Flag, Mode
from ..models.reconstruction import Reconstruction

RUN_FILE = "run.toml"


@contextmanager
def result_directory(path: Path) -> Iterator[Path]:
    """Give a directory to write into; it takes the name `path` when the block ends without an error.

    Raises:
        InputError: when something else than an earlier result stands at `path`, or it can not be written.
    """
    check_result_path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    except OSError as error:
        raise InputError(f"{path}: can not be written: {error}") from error
    try:
        yield temporary
        temporary.chmod(0o755)
        if path.exists():
            shutil.rmtree(path)
        temporary.rename(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_result_path(path: Path) -> None:
    """Refuse to replace anything but an earlier result.

    Raises:
        InputError: when `path` is something else.
    """
    if path.exists() and not (path.is_dir() and ((path / RUN_FILE).is_file() or not any(path.iterdir()))):
        raise InputError(
            f"{path}: exists and is no earlier result: expected a new name, or a directory with {RUN_FILE}"
        )


def append_tables(reconstruction: Reconstruction, probability: float, directory: Path) -> None:
    """Write shape.csv, ellipsoids.csv, lengths.csv and status.csv, or go on with them: a live run comes in parts."""
    _append(directory / "shape.csv", _shape_rows(reconstruction))
    _append(directory / "ellipsoids.csv", _ellipsoid_rows(reconstruction, probability))
    _append(directory / "lengths.csv", _length_rows(reconstruction))
    _append(directory / "status.csv", _status_rows(reconstruction))


def write_run(run: Mapping[str, Any], directory: Path) -> None:
    """Write run.toml."""
    (directory / RUN_FILE).write_text(tomli_w.dumps(run), encoding="utf-8")


def _append(path: Path, rows: Iterator[str]) -> None:
    """Add rows to a table; the first, its header, only where there is none yet."""
    header = next(rows)
    with path.open("a", encoding="utf-8", newline="\n") as file:
        if file.tell() == 0:
            file.write(f"{header}\n")
        file.writelines(f"{row}\n" for row in rows)


def _shape_rows(r: Reconstruction) -> Iterator[str]:
    nodes = range(r.structure.node_count)
    yield ",".join(["t_s", *(f"n{n}_{axis}_m" for n in nodes for axis in "xyz")])
    for t_s, position in zip(r.t_s, r.node_position_m.reshape(len(r), -1), strict=True):
        yield f"{t_s:.4f}," + ",".join(f"{value:.6f}" for value in position)


def _ellipsoid_rows(r: Reconstruction, probability: float) -> Iterator[str]:
    yield (
        "t_s,node,x_m,y_m,z_m,cxx_m2,cxy_m2,cxz_m2,cyy_m2,cyz_m2,czz_m2,"
        "semi_a_m,semi_b_m,semi_c_m,qx,qy,qz,qw,probability"
    )
    regions = r.ellipsoids(probability)
    quaternion = Rotation.from_matrix(regions.axes.reshape(-1, 3, 3)).as_quat().reshape(*regions.axes.shape[:2], 4)
    upper = np.triu_indices(3)
    covariance = r.node_covariance_m2[..., upper[0], upper[1]]
    for k, t_s in enumerate(r.t_s):
        for node in range(r.structure.node_count):
            yield (
                f"{t_s:.4f},{node},"
                + ",".join(f"{v:.6f}" for v in r.node_position_m[k, node])
                + "," + ",".join(f"{v:.6e}" for v in covariance[k, node])
                + "," + ",".join(f"{v:.6f}" for v in regions.semi_axis_m[k, node])
                + "," + ",".join(f"{v:.6f}" for v in quaternion[k, node])
                + f",{probability:g}"
            )  # fmt: skip


def _length_rows(r: Reconstruction) -> Iterator[str]:
    yield "t_s,tendon,length_m,sigma_m,mode,flags,predicted_m,innovation_sigma_m"
    modes = {int(mode): mode.name.lower() for mode in Mode}
    names = {int(flags): Flag(int(flags)).names() for flags in np.unique(r.flags)}
    for k, t_s in enumerate(r.t_s):
        for e in range(len(r.structure.tendons)):
            yield (
                f"{t_s:.4f},{e},{r.length_m[k, e]:.6f},{r.sigma_m[k, e]:.6f},{modes[int(r.mode[k, e])]},"
                f"{names[int(r.flags[k, e])]},{r.predicted_m[k, e]:.6f},{r.innovation_sigma_m[k, e]:.6f}"
            )


def _status_rows(r: Reconstruction) -> Iterator[str]:
    yield "t_s,status,smallest_singular_value,mechanism_sigma_m"
    for t_s, status, value, sigma_m in zip(
        r.t_s, r.status, r.smallest_singular_value, r.mechanism_sigma_m, strict=True
    ):
        yield f"{t_s:.4f},{status},{value:.6f},{sigma_m:.6f}"
