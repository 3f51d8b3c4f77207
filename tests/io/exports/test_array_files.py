"""NPZ, MAT, NetCDF and Parquet, read back by other libraries than those that wrote them."""

import json
import resource
import sys

import numpy as np
import pytest
from scipy.io import loadmat

import tensegraph as tg
from tensegraph.models.structure.quantities import LABELS, QUANTITIES


def test_every_array_has_the_dimensions_that_are_told(short_run) -> None:
    structure = short_run.structure
    size = {"t_s": len(short_run), "node": 12, "tendon": 24, "rod": 6} | {n: len(names) for n, names in LABELS.items()}
    for name, values in short_run.arrays().items():
        assert values.shape == tuple(size[dimension] for dimension in QUANTITIES[name].dimensions), name
        assert (QUANTITIES[name].unit == "") == (values.dtype.kind == "U")
        named = QUANTITIES[name].columns
        per_member = [d for d in QUANTITIES[name].dimensions if d not in ("t_s", "node", "tendon", "rod")]
        assert not named or len(named) == np.prod([size[dimension] for dimension in per_member])
    assert structure.node_count == 12


def test_a_mat_file(short_run, tmp_path) -> None:
    (path,) = tg.export(short_run, tmp_path / "run.mat", about={"trial": "press"})
    read = loadmat(path, simplify_cells=True)
    np.testing.assert_array_equal(read["node_position_m"], short_run.node_position_m)
    np.testing.assert_array_equal(read["length_m"], short_run.length_m)
    assert read["status"][3] == "two_shapes"
    assert read["about"]["units"]["load_n"] == "N"
    assert read["about"]["trial"] == "press"
    assert read["about"]["coordinate_frame"] == "anchors"
    stuck = read["about"]["codes"]["flags"]["stuck"]
    assert np.argwhere(read["flags"] & stuck).tolist() == [[2, 5]]
    for name in ("t_s", "status"):
        assert loadmat(path)[name].shape == (len(short_run), 1)  # a column, as MATLAB has it


def test_an_npz_file_without_pickles(short_run, tmp_path) -> None:
    (path,) = tg.export(short_run, tmp_path / "run.npz", probability=0.5)
    with np.load(path, allow_pickle=False) as read:
        assert {*read} == {*short_run.arrays(), "about"}
        for name, values in short_run.arrays(0.5).items():
            np.testing.assert_array_equal(read[name], values)
        about = json.loads(str(read["about"]))
    assert about["probability"] == 0.5
    assert about["dimensions"]["node_covariance_m2"] == "t_s, node, axis, other_axis"


def test_a_netcdf_file(short_run, tmp_path) -> None:
    netcdf = pytest.importorskip("netCDF4")
    (path,) = tg.export(short_run, tmp_path / "run.nc", about={"trial": "nul \0 in a name"})
    with netcdf.Dataset(path) as read:
        np.testing.assert_array_equal(read["node_position_m"][:], short_run.node_position_m)
        assert read["node_position_m"].dimensions == ("t_s", "node", "axis")
        assert read["node_position_m"].units == "m"
        masks = dict(zip(read["flags"].flag_meanings.split(), read["flags"].flag_masks, strict=True))
        assert masks["stuck"] == tg.Flag.STUCK
        assert list(read["axis"][:]) == ["x", "y", "z"]
        assert read["doubt"][-1] == "many_loads"
        assert read.coordinate_frame == "anchors"
        assert read.Conventions == "CF-1.9"
        assert "_FillValue" not in read["t_s"].ncattrs()
        assert read.trial == r"nul \x00 in a name"


def test_netcdf_on_a_full_disk_leaves_nothing(short_run, tmp_path) -> None:
    """HDF5 ends the process with a segmentation fault where it writes itself."""
    pytest.importorskip("xarray")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limits[1]))
        with pytest.raises(tg.InputError, match=r"run\.nc: cannot be written: File too large"):
            tg.export(short_run, tmp_path / "run.nc")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


def test_xarray_finds_frames_and_components_by_their_labels(short_run, tmp_path) -> None:
    xarray = pytest.importorskip("xarray")
    dataset = short_run.to_xarray()
    found = dataset.sel(t_s=0.21, method="nearest").node_position_m.sel(axis="z")
    np.testing.assert_array_equal(found, short_run[0.21].node_position_m[:, 2])
    assert dataset.load_n.attrs["units"] == "N"
    tg.export(short_run, tmp_path / "run.nc")
    with xarray.open_dataset(tmp_path / "run.nc") as read:
        xarray.testing.assert_identical(read.load(), dataset.assign_attrs(Conventions="CF-1.9"))


def test_parquet_files(short_run, tmp_path) -> None:
    duckdb = pytest.importorskip("duckdb")
    paths = tg.export(short_run, tmp_path / "run.parquet")
    assert [path.name for path in paths] == ["run.frames.parquet", "run.nodes.parquet", "run.tendons.parquet"]
    frames, nodes, tendons = (f"'{path}'" for path in paths)
    rows = duckdb.sql(f"select x_m, czz_m2 from {nodes} where node = 7 order by t_s").fetchnumpy()
    np.testing.assert_array_equal(rows["x_m"], short_run.node_position_m[:, 7, 0])
    np.testing.assert_array_equal(rows["czz_m2"], short_run.node_covariance_m2[:, 7, 2, 2])
    bent = duckdb.sql(f"select tendon, flags, length_m from {tendons} where mode = 'bending'").fetchall()
    assert [(tendon, flags) for tendon, flags, _ in bent] == [(5, "missing|stuck")]
    assert np.isnan(bent[0][2])
    wide = duckdb.sql(f"select n7_x_m, t5_mode, status from {frames} order by t_s").fetchnumpy()
    np.testing.assert_array_equal(wide["n7_x_m"], rows["x_m"])
    assert wide["t5_mode"][2] == "bending"
    assert wide["status"][3] == "two_shapes"


def test_parquet_says_units_frame_and_structure(short_run, tmp_path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    *_, path = tg.export(short_run, tmp_path / "run.parquet", about={"method": "live"})
    schema = parquet.read_schema(path)
    assert schema.field("sigma_m").metadata[b"unit"] == b"m"
    about = json.loads(schema.metadata[b"tensegraph"])
    assert (about["method"], about["coordinate_frame"]) == ("live", "anchors")
    assert about["tendons"] == short_run.structure.tendons.tolist()


def test_data_frames(short_run) -> None:
    pytest.importorskip("pandas")
    nodes = short_run.to_dataframe("nodes")
    assert len(nodes) == 12 * len(short_run)
    one = nodes[(nodes.node == 4) & (nodes.t_s == short_run.t_s[2])]
    np.testing.assert_array_equal(one[["x_m", "y_m", "z_m"]].to_numpy()[0], short_run.node_position_m[2, 4])
    assert nodes.attrs["units"]["fx_n"] == "N"
    frames = short_run.to_dataframe()
    assert len(frames) == len(short_run)
    np.testing.assert_array_equal(frames.t9_predicted_m, short_run.predicted_m[:, 9])
    with pytest.raises(tg.InputError, match="table 'rods': expected one of frames, nodes, tendons"):
        short_run.to_dataframe("rods")


@pytest.mark.parametrize(
    ("library", "file", "extra"),
    [
        ("pyarrow", "run.parquet", "tables"),
        ("xarray", "run.nc", "tables"),
        ("h5py", "run.nc", "tables"),
        ("rosbags", "run.mcap", "ros2"),
        ("imageio_ffmpeg", "run.mp4", "video"),
    ],
)
def test_a_missing_library_is_one_line_and_leaves_what_is_there(
    short_run, tmp_path, monkeypatch, library, file, extra
) -> None:
    names = [file] if file != "run.parquet" else [f"run.{table}.parquet" for table in ("frames", "nodes", "tendons")]
    for name in names:
        (tmp_path / name).write_text("earlier")
    for name in [name for name in sys.modules if name.split(".")[0] == library]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(tg.InputError, match=rf"needs {library}[\w.]*: pip install 'tensegraph\[{extra}\]'"):
        tg.export(short_run, tmp_path / file)
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert all((tmp_path / name).read_text() == "earlier" for name in names)
