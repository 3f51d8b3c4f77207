"""`tensegraph export`: what a user types, and what is refused."""

import shutil
from typing import get_args, get_type_hints

import numpy as np
import pytest
from scipy.io import loadmat

import tensegraph as tg
from command_line import refusal_of, run
from tensegraph import cli
from tensegraph.io.exports.formats import SUFFIXES


def test_the_help_names_the_formats() -> None:
    help_text = get_args(get_type_hints(cli.export, include_extras=True)["to"])[1].help
    assert f"Format: {', '.join(SUFFIXES)}, or one of another package." == help_text


def test_a_result_beside_itself_or_anywhere(done, tmp_path) -> None:
    folder, *_ = done
    shutil.copytree(folder / "results" / "press", tmp_path / "press")
    beside = run("export", "press", "--to", "mat", cwd=tmp_path)
    assert (beside.returncode, beside.stderr) == (0, "")
    assert beside.stdout == "written to press.mat\n"
    shape = np.genfromtxt(tmp_path / "press" / "shape.csv", delimiter=",", skip_header=1)
    read = loadmat(tmp_path / "press.mat", simplify_cells=True)
    np.testing.assert_array_equal(read["node_position_m"].reshape(len(shape), -1), shape[:, 1:])
    assert (read["about"]["trial"], read["about"]["method"]) == ("press_01", "batch")
    assert read["about"]["tensegraph"] == tg.__version__
    within = run("export", ".", "--to", "npz", cwd=tmp_path / "press")
    assert (within.returncode, within.stderr) == (0, "")
    assert (tmp_path / "press.npz").exists()
    anywhere = run("export", "press", "--out", "new/scene.glb", "--at", "1", "--quiet", cwd=tmp_path)
    assert (anywhere.returncode, anywhere.stderr) == (0, "")
    assert (tmp_path / "new" / "scene.glb").read_bytes()[:4] == b"glTF"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "expected --to with one of mat, npz"),
        (["--out", "press"], "press: expected a name that ends in .mat, .npz"),
        (["--to", "mat", "--out", "press.nc"], "--out press.nc: expected a name that ends in .mat for --to mat"),
        (["--to", "gltf"], "press.glb: holds one frame: expected its time, --at or at_s, from 0.00 to"),
        (["--to", "ply", "--at", "99"], "expected its time, --at or at_s, from 0.00 to 4.04 s, got 99"),
        (["--to", "mat", "--at", "1"], ".mat holds all frames: expected no time"),
        (["--out", "folder.mat"], "folder.mat: is a directory: expected the name of a file"),
    ],
)
def test_what_is_refused_is_one_line_and_leaves_nothing(done, tmp_path, arguments, message) -> None:
    shutil.copytree(done[0] / "results" / "press", tmp_path / "press")
    (tmp_path / "folder.mat").mkdir()
    assert message in refusal_of("export", "press", *arguments, cwd=tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.mat", "press"]
