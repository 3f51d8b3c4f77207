"""Files that are there whole or not at all: what is replaced, what is refused, what is left after an error."""

import os
import resource
import signal
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tensegraph import InputError
from tensegraph.io.whole import check_replaceable, check_vacant, written_whole


def test_files_and_directories_take_their_places_together(tmp_path) -> None:
    """An earlier directory is replaced as a whole, an earlier file too; nothing else is left."""
    folder, file = tmp_path / "figures", tmp_path / "model"
    folder.mkdir()
    (folder / "losses.png").write_text("old")
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
    for check in (check_vacant, lambda path: check_replaceable(path, ("run.toml",))):
        with pytest.raises(InputError, match=r"file is not a directory"):
            check(tmp_path / "file" / "more" / "out")


def test_a_directory_without_permission_is_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write anywhere
    with pytest.raises(InputError, match=f"no permission to write in {tmp_path}"):
        check_vacant(tmp_path / "out")


def result(path: Path) -> Path:
    """An earlier result in which someone keeps a file and a folder of their own."""
    (path / "mine").mkdir(parents=True)
    (path / "mine" / "thesis.tex").write_text("mine")
    (path / "notes.txt").write_text("mine")
    for name in ("run.toml", "shape.csv", "slips.csv"):
        (path / name).write_text("old")
    return path


def write(path: Path) -> None:
    with written_whole(path) as (inside,):
        inside.mkdir()
        for name in ("run.toml", "shape.csv"):
            (inside / name).write_text("new")


def test_what_no_command_wrote_stays_in_a_result(tmp_path) -> None:
    """Slips of the earlier run are gone, because the new one has none; files and folders of the user are there."""
    path = result(tmp_path / "out")
    write(path)
    assert sorted(p.name for p in path.iterdir()) == ["mine", "notes.txt", "run.toml", "shape.csv"]
    assert (path / "mine" / "thesis.tex").read_text() == "mine"
    assert (path / "shape.csv").read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("out", [".", "", "../out"])
def test_the_working_directory_is_not_replaced(tmp_path, monkeypatch, out) -> None:
    """The shell from which the command runs would stay in a directory that is no longer there."""
    monkeypatch.chdir(result(tmp_path / "out"))
    with pytest.raises(InputError, match="is the working directory, or contains it: expected another place"):
        check_replaceable(Path(out), ("run.toml",))


def test_what_cannot_be_moved_away_is_refused_before_any_work(tmp_path, monkeypatch) -> None:
    """A mount point, as a container has for its results, and a directory of somebody else."""
    path = result(tmp_path / "out")
    monkeypatch.setattr(Path, "is_mount", lambda place: place == path)
    with pytest.raises(InputError, match="out: is a mount point, which cannot be replaced: expected a directory in it"):
        check_replaceable(path, ("run.toml",))
    check_replaceable(path / "run_01", ("run.toml",))
    monkeypatch.undo()
    monkeypatch.setattr(os, "access", lambda place, mode: Path(place) != path)
    with pytest.raises(InputError, match="out: cannot be written: no permission to write in it"):
        check_replaceable(path, ("run.toml",))


def test_directories_that_were_made_for_nothing_are_removed(tmp_path) -> None:
    (tmp_path / "mine").mkdir()
    with pytest.raises(InputError), written_whole(tmp_path / "mine" / "a" / "b" / "out"):
        raise InputError("refused")
    assert not any((tmp_path / "mine").iterdir())


def test_a_simulated_trial_is_replaced_whole(tmp_path) -> None:
    """A plan that has fewer boards by now; what the user has put beside them stays."""
    (tmp_path / "out").mkdir()
    for file in ("simulation.toml", "board0.csv", "board1.csv", "imu0.csv", "truth.csv", "notes.txt"):
        (tmp_path / "out" / file).write_text("old")
    with written_whole(tmp_path / "out") as (inside,):
        inside.mkdir()
        (inside / "board0.csv").write_text("new")
    assert {path.name: path.read_text() for path in (tmp_path / "out").iterdir()} == {
        "board0.csv": "new",
        "notes.txt": "old",
    }


def test_a_link_stays_a_link(tmp_path) -> None:
    """The result is where the link leads to."""
    path = result(tmp_path / "disk" / "out")
    (tmp_path / "out").symlink_to(path)
    check_replaceable(tmp_path / "out", ("run.toml",))
    write(tmp_path / "out")
    assert (tmp_path / "out").is_symlink()
    assert (path / "shape.csv").read_text() == "new"
    assert (path / "notes.txt").read_text() == "mine"


def test_a_link_to_a_file_of_another_name_stays_one_too(tmp_path) -> None:
    """What is written has the link's name, whose end tells a library the format."""
    for name in ("a.md", "b.txt"):
        (tmp_path / name).write_text("old")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "plot.png").symlink_to("../a.md")
    (tmp_path / "out" / "table.csv").symlink_to("../b.txt")
    with written_whole(tmp_path / "out" / "table.csv", tmp_path / "out" / "plot.png") as (table, plot):
        assert (table.name, plot.name) == ("table.csv", "plot.png")
        table.write_text("table")
        plot.write_text("plot")
    assert [(tmp_path / name).read_text() for name in ("a.md", "b.txt")] == ["plot", "table"]
    assert (tmp_path / "out" / "plot.png").is_symlink()
    assert {path.name for path in tmp_path.rglob("*")} == {"a.md", "b.txt", "out", "plot.png", "table.csv"}


@pytest.mark.parametrize("kind", ["device", "pipe"])
def test_what_is_no_file_is_neither_copied_nor_replaced(tmp_path, kind) -> None:
    """As a link to /dev/zero, which would fill the disk, where a table of an earlier comparison was."""
    if kind == "device":
        (tmp_path / "table.md").symlink_to("/dev/zero")
    else:
        os.mkfifo(tmp_path / "table.md")
    with (
        pytest.raises(InputError, match=r"table\.md: exists and is neither a file nor a directory: expected a new"),
        written_whole(tmp_path / "table.csv", tmp_path / "table.md"),
    ):
        pytest.fail("the work is not begun")
    assert [path.name for path in tmp_path.iterdir()] == ["table.md"]


OTHER_DISK = Path("/dev/shm")


@pytest.mark.skipif(not OTHER_DISK.is_dir(), reason="there is no file system that is surely another one")
def test_a_link_to_another_file_system_is_refused(tmp_path) -> None:
    """The files before it are as they were, and nothing hidden is left."""
    if OTHER_DISK.stat().st_dev == tmp_path.stat().st_dev:
        pytest.skip("the tests run on it")
    with tempfile.TemporaryDirectory(dir=OTHER_DISK) as other:
        there = Path(other) / "file.md"
        there.write_text("old")
        (tmp_path / "first").write_text("old")
        (tmp_path / "second").symlink_to(there)

        def write() -> None:
            with written_whole(tmp_path / "first", tmp_path / "second") as inside:
                for path in inside:
                    path.write_text("new")

        with pytest.raises(InputError, match=r"file\.md: cannot be written through a link of another file system"):
            write()
        assert there.read_text() == "old"
    assert (tmp_path / "first").read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first", "second"]


def test_nothing_hidden_is_left_where_one_descriptor_is_free(tmp_path) -> None:
    held = []

    def write() -> None:
        with written_whole(tmp_path / "out") as (inside,):
            (inside / "figures" / "more").mkdir(parents=True)
            (inside / "figures" / "more" / "file").write_text("half")
            while True:
                held.append(os.open(os.devnull, os.O_RDONLY))

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(map(int, os.listdir("/dev/fd"))) + 8, hard))
    try:
        with pytest.raises(OSError, match="Too many open files"):
            write()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        for descriptor in held:
            os.close(descriptor)
    assert not list(tmp_path.iterdir())


def test_a_mount_point_is_left_as_it_is(tmp_path, monkeypatch) -> None:
    """A system does not move it; the result is refused, and what was there stays."""
    path = result(tmp_path / "out")
    rename = Path.rename

    def move(self: Path, target: Path) -> Path:
        if self == path:
            raise OSError(16, "Device or resource busy")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", move)
    with pytest.raises(InputError, match="out: cannot be written: Device or resource busy"):
        write(path)
    assert (path / "shape.csv").read_text() == "old"
    assert (path / "mine" / "thesis.tex").read_text() == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_nobody_else_may_look_into_what_is_being_written(tmp_path) -> None:
    with written_whole(tmp_path / "out") as (inside,):
        assert stat.S_IMODE(inside.parent.stat().st_mode) == 0o700
        inside.write_text("x")
    umask = os.umask(0)
    os.umask(umask)
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o666 & ~umask


KILLED = """
import os, signal, sys
from pathlib import Path
from tensegraph.io import whole

def killed(*_):
    os.kill(os.getpid(), signal.SIGKILL)

if sys.argv[2] == "moving":
    whole._keep_others = killed
if sys.argv[2] == "moved aside":
    replace = Path.replace
    Path.replace = lambda self, target: killed() if self.name == "out" else replace(self, target)
with whole.written_whole(Path(sys.argv[1])) as (inside,):
    inside.mkdir()
    (inside / "run.toml").write_text("killed")
    if sys.argv[2] == "writing":
        killed()
"""


@pytest.mark.parametrize("moment", ["writing", "moved aside", "moving"])
def test_what_a_killed_run_left_is_removed_by_the_next_one(tmp_path, moment) -> None:
    """At every moment of its end; what it had moved aside comes back."""
    path = result(tmp_path / "out")
    ended = subprocess.run([sys.executable, "-c", KILLED, path, moment], check=False)
    assert ended.returncode == -signal.SIGKILL
    assert len(list(tmp_path.glob(".out-*"))) == (1 if moment == "writing" else 2)
    write(path)
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert (path / "notes.txt").read_text() == "mine"
    assert (path / "mine" / "thesis.tex").read_text() == "mine"
    assert (path / "shape.csv").read_text() == "new"


def test_what_another_run_is_writing_stays(tmp_path) -> None:
    """Two runs to one place at once, and a folder that only looks alike."""
    (tmp_path / ".out-mine").mkdir()
    with written_whole(tmp_path / "out") as (first,):
        first.write_text("first")
        with written_whole(tmp_path / "out") as (second,):
            second.write_text("second")
        assert first.read_text() == "first"
    assert (tmp_path / "out").read_text() == "first"
    assert sorted(p.name for p in tmp_path.iterdir()) == [".out-mine", "out"]


def test_an_interruption_while_the_hidden_directory_is_removed_is_one(tmp_path, monkeypatch) -> None:
    """`shutil.rmtree` closes its directory once more after it, and would raise that the descriptor is bad."""
    close, closed = os.close, []

    def close_and_interrupt(descriptor: int) -> None:
        close(descriptor)
        if not closed:
            closed.append(descriptor)
            raise KeyboardInterrupt

    def write() -> None:
        with written_whole(tmp_path / "file") as (inside,):
            inside.write_text("whole")
            monkeypatch.setattr("tensegraph.io.whole._sync", lambda path: None)
            monkeypatch.setattr("tensegraph.io.whole._sync_all", lambda path: None)
            monkeypatch.setattr(os, "close", close_and_interrupt)

    with pytest.raises(KeyboardInterrupt):
        write()
    assert closed
    assert (tmp_path / "file").read_text() == "whole"
