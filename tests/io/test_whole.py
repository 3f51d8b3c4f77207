"""Files that are there whole or not at all: what is replaced, what is refused, what is left after an error."""

import os
import stat
from pathlib import Path

import pytest

from tensegraph import InputError
from tensegraph.io.whole import check_replaceable, check_vacant, written_whole


def test_files_and_directories_take_their_places_together(tmp_path) -> None:
    """An earlier directory is replaced as a whole, an earlier file too; nothing else is left."""
    folder, file = tmp_path / "figures", tmp_path / "model"
    folder.mkdir()
    (folder / "old.png").write_text("old")
    file.write_text("old")
    with written_whole(folder, file) as (new_folder, new_file):
        new_folder.mkdir()
        (new_folder / "new.png").write_text("new")
        new_file.write_text("new")
        assert file.read_text() == "old"
    assert [path.name for path in folder.iterdir()] == ["new.png"]
    assert file.read_text() == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figures", "model"]


def test_an_error_leaves_what_was_there(tmp_path) -> None:
    (tmp_path / "model").write_text("old")

    def fail() -> None:
        with written_whole(tmp_path / "model") as (new,):
            new.write_text("half")
            raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        fail()
    assert (tmp_path / "model").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["model"]


def test_what_the_system_refuses_is_an_input_error(tmp_path) -> None:
    with (
        pytest.raises(InputError, match="out: cannot be written: No space left on device"),
        written_whole(tmp_path / "out"),
    ):
        raise OSError(28, "No space left on device")
    assert not list(tmp_path.iterdir())


def test_an_error_that_is_not_of_writing_stays_what_it_is(tmp_path) -> None:
    """A file that cannot be read inside the block is not reported as an output that cannot be written."""
    with pytest.raises(FileNotFoundError), written_whole(tmp_path / "out"):
        (tmp_path / "absent").read_text()
    assert not list(tmp_path.iterdir())


def test_a_move_that_fails_gives_back_what_was_there(tmp_path, monkeypatch) -> None:
    """The second move fails: the directory moved first and the file are as they were, and nothing else is left."""
    folder, file, other = tmp_path / "figures", tmp_path / "model", tmp_path / "new"
    folder.mkdir()
    (folder / "old.png").write_text("old")
    file.write_text("old")
    replace = Path.replace

    def fails_for_the_model(self: Path, target: Path) -> Path:
        if target == file and self.read_text() == "new":
            raise OSError(5, "Input/output error")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", fails_for_the_model)

    def write() -> None:
        with written_whole(folder, other, file) as (new_folder, new_other, new_file):
            new_folder.mkdir()
            new_other.write_text("new")
            new_file.write_text("new")

    with pytest.raises(InputError, match="model: cannot be written: Input/output error"):
        write()
    assert [path.name for path in folder.iterdir()] == ["old.png"]
    assert file.read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figures", "model"]


def test_a_directory_whose_own_move_fails_is_given_back(tmp_path, monkeypatch) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "run.toml").write_text("old")

    def fail(self: Path, target: Path) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(InputError, match="out: cannot be written"), written_whole(tmp_path / "out") as (inside,):
        inside.mkdir()
    assert (tmp_path / "out" / "run.toml").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_modes_follow_the_umask(tmp_path) -> None:
    earlier = os.umask(0o027)
    try:
        with written_whole(tmp_path / "out") as (inside,):
            inside.mkdir()
            (inside / "file").write_text("")
    finally:
        os.umask(earlier)
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (tmp_path / "out", tmp_path / "out" / "file")]
    assert modes == [0o750, 0o640]


def test_nothing_is_written_below_a_file(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    for check in (check_vacant, lambda path: check_replaceable(path, "run.toml")):
        with pytest.raises(InputError, match=r"file is not a directory"):
            check(tmp_path / "file" / "more" / "out")


def test_a_directory_without_permission_is_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write anywhere
    with pytest.raises(InputError, match=f"no permission to write in {tmp_path}"):
        check_vacant(tmp_path / "out")
