"""All quantities of a run as named arrays: NumPy's NPZ, MATLAB's MAT-file, NetCDF."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.structure.labelled import as_dataset
from ...models.structure.quantities import QUANTITIES
from ...models.values.errors import needs_extra

CF = {"Conventions": "CF-1.9"}
"""By which programs know what units and flags mean; whole numbers of 64 bits are allowed from this version on."""


def write_npz(arrays: Mapping[str, NDArray[Any]], about: Mapping[str, Any], path: Path) -> None:
    """Write a compressed NPZ, with one more array: `about`, a text of JSON with attributes, units, meanings and codes.

    Args:
        arrays: the quantities by name, see `QUANTITIES`.
        about: attributes of the run.
        path: of the file, which ends in .npz.
    """
    np.savez_compressed(path, allow_pickle=False, about=np.array(json.dumps({**about, **_described(arrays)})), **arrays)


def write_mat(arrays: Mapping[str, NDArray[Any]], about: Mapping[str, Any], path: Path) -> None:
    """Write a MAT-file of version 5, with one more struct: `about`, with attributes, units, meanings and codes.

    Words are cells. Nodes and tendons are numbered from 0, as everywhere; columns of an array from 1, as in MATLAB.

    Args:
        arrays: see `write_npz`.
        about: see `write_npz`.
        path: of the file.
    """
    from scipy.io import savemat  # imported where such a file is written

    variables = {name: values.astype(object) if values.dtype.kind == "U" else values for name, values in arrays.items()}
    savemat(
        path,
        {**variables, "about": {**about, **_described(arrays)}},
        long_field_names=True,
        do_compression=True,
        oned_as="column",
    )


def write_netcdf(arrays: Mapping[str, NDArray[Any]], about: Mapping[str, Any], path: Path) -> None:
    """Write a NetCDF-4 file, with units and meanings as the CF conventions have them.

    Args:
        arrays: see `write_npz`.
        about: see `write_npz`.
        path: of the file.

    Raises:
        InputError: when xarray, h5netcdf or h5py is not installed.
    """
    with needs_extra("NetCDF", "tables"):
        import h5netcdf  # noqa: F401  (xarray imports the engine by its name, and the engine its library)
        import h5py  # noqa: F401
    encoding: dict[str, dict[str, Any]] = {
        n: {"zlib": True} for n, values in arrays.items() if values.dtype.kind in "fi"
    }
    encoding["t_s"]["_FillValue"] = None  # a coordinate may miss no value
    path.write_bytes(as_dataset(arrays, {**CF, **about}).to_netcdf(engine="h5netcdf", encoding=encoding))


def _described(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return dimensions, units and meanings of quantities by name, and the number of each word where they are coded."""
    return {
        "dimensions": {name: ", ".join(QUANTITIES[name].dimensions) for name in arrays},
        "units": {name: QUANTITIES[name].unit for name in arrays},
        "meanings": {name: QUANTITIES[name].meaning for name in arrays},
        "codes": {
            name: {word: code for code, word in QUANTITIES[name].codes.items()}
            for name in arrays
            if QUANTITIES[name].codes
        },
    }
