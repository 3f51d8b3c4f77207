"""What is kept of a trial in a comparison, where the file is damaged."""

import numpy as np
import pytest

from tensegraph.io.measured_trials import read_measured, write_measured
from tensegraph.models.evaluation.comparison import FrameErrors, Measured


@pytest.mark.parametrize("content", [b"", b"not an archive"])
def test_a_file_that_was_not_written_to_its_end_is_none(tmp_path, content) -> None:
    """As of a disk that was full: the trial is measured again."""
    path = tmp_path / "press_01.npz"
    path.write_bytes(content)
    assert read_measured(path, "fingerprint") is None


def test_a_file_in_which_a_byte_was_changed_is_none_or_what_was_written(tmp_path) -> None:
    """Of the archive's kinds of damage each has an error of its own: encrypted, by another method, a wrong sum."""
    path = tmp_path / "press_01.npz"
    write_measured([Measured("press_01", "live", 10, 0.5, None)], "fingerprint", path)
    whole = path.read_bytes()
    assert [m.frames for m in read_measured(path, "fingerprint")] == [10]
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        found = read_measured(path, "fingerprint")
        assert found is None or [m.frames for m in found] == [10]


def test_another_archive_is_none(tmp_path) -> None:
    path = tmp_path / "press_01.npz"
    np.savez(path, about=np.array("[1]"))
    assert read_measured(path, "fingerprint") is None


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("node_sigma_m", np.array(1.0)),
        ("node_error_m", np.zeros((10, 8, 3))),
        ("face_error_m", np.zeros((9, 2, 3))),
        ("nees", np.full((10, 9), "many")),
        ("nees", np.zeros((10, 9), dtype=np.complex128)),
        ("wrong_branch", np.zeros(9, dtype=np.bool_)),
    ],
)
def test_arrays_of_other_shapes_or_types_are_none(tmp_path, name, values) -> None:
    path = tmp_path / "press_01.npz"
    frames, nodes = np.zeros((10, 9)), np.zeros((10, 9, 3))
    errors = FrameErrors(nodes, np.zeros((10, 2, 3)), frames, frames, np.zeros(10, dtype=np.bool_))
    write_measured([Measured("press_01", "live", 10, 0.5, errors)], "fingerprint", path)
    assert read_measured(path, "fingerprint")[0].errors.nees.shape == (10, 9)
    with np.load(path) as stored:
        arrays = dict(stored)
    np.savez(path, **(arrays | {f"live: {name}": values}))
    assert read_measured(path, "fingerprint") is None
    for kept in arrays:
        np.savez(path, **{other: arrays[other] for other in arrays if other != kept})
        found = read_measured(path, "fingerprint")
        assert found is None or kept == "live: wrong_branch" or found[0].errors is None
