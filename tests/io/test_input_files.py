"""Files that never end or wait for ever, and names that lead out of a trial: as a user meets them, and at once."""

import hashlib
import os
import tracemalloc
from io import StringIO
from pathlib import Path

import pytest

from command_line import printed_by, refusal_of
from tensegraph import InputError
from tensegraph.io.csv import CsvFile
from tensegraph.io.input_files import LONGEST_LINE, check_regular, line_count, lines_of
from tensegraph.io.mocap.truth_file import read_truth
from tensegraph.io.model_file import read_sensor_model
from tensegraph.io.provenance import sha256_of
from tensegraph.io.toml import read_toml

READERS = {
    "toml": read_toml,
    "csv": lambda path: list(CsvFile(path, ["t_s"])),
    "model": read_sensor_model,
    "truth": lambda path: read_truth(path, 12),
    "c3d": lambda path: read_truth(path, 12),
}


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("what", ["a directory", "a pipe", "a device or a socket"])
def test_what_is_no_file_is_refused_before_it_is_opened(tmp_path, kind, what) -> None:
    path = tmp_path / f"input.{kind}"
    if what == "a directory":
        path.mkdir()
    elif what == "a pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    with pytest.raises(InputError, match=f"input.{kind}: expected a file, got {what}"):
        READERS[kind](path)


def test_a_line_of_a_gigabyte_is_not_read_to_its_end(tmp_path) -> None:
    path = tmp_path / "rows.csv"
    path.write_bytes(b"t_s\n1\n")
    os.truncate(path, 1 << 30)  # a hole, which takes no space on the disk
    with pytest.raises(InputError, match=f"row 3: expected at most {LONGEST_LINE} characters in a line"):
        list(CsvFile(path, ["t_s"]))
    with pytest.raises(InputError, match="expected at most 1 MiB, got 1024 MiB"):
        read_toml(path)


def test_a_table_without_a_first_line_is_not_hashed(tmp_path) -> None:
    path = tmp_path / "rows.csv"
    path.touch()
    os.truncate(path, 1 << 40)
    with pytest.raises(InputError, match=f"row 1: expected at most {LONGEST_LINE} characters in a line"):
        sha256_of(path)


@pytest.mark.parametrize("name", ["bag.mcap", "bag.db3"])
def test_a_bag_that_does_not_begin_as_one_is_not_hashed(tmp_path, name) -> None:
    path = tmp_path / name
    path.touch()
    os.truncate(path, 1 << 40)
    with pytest.raises(InputError, match=f"{name}: cannot be read as a bag: it does not begin as one"):
        sha256_of(path)


def test_a_large_file_is_hashed_and_counted_in_parts(tmp_path) -> None:
    path = tmp_path / "rows.csv"
    path.write_bytes(b"t_s\n1\n")
    os.truncate(path, 1 << 28)
    tracemalloc.start()
    told = sha256_of(path), line_count(path)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert told == (hashlib.sha256(path.read_bytes()).hexdigest(), 2)
    assert peak_bytes < 1 << 23


def test_the_hash_of_a_directory_is_that_of_the_names_and_bytes_of_its_files(tmp_path) -> None:
    for name in ("b.txt", "a.yaml"):
        (tmp_path / name).write_bytes(b"of " + name.encode())
    assert sha256_of(tmp_path) == hashlib.sha256(b"a.yamlof a.yamlb.txtof b.txt").hexdigest()


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n"])
def test_lines_are_counted_by_any_line_end(tmp_path, end) -> None:
    (tmp_path / "rows.csv").write_text(f"t_s{end}1{end}2{end}3", newline="")
    assert line_count(tmp_path / "rows.csv") == 3


def test_lines_keep_their_ends() -> None:
    text = "a\n\nb\r\nc"
    assert list(lines_of(StringIO(text, newline=""), Path("x"))) == ["a\n", "\n", "b\r\n", "c"]
    longest = "x" * (LONGEST_LINE - 1) + "\n"
    assert list(lines_of(StringIO(longest), Path("x"))) == [longest]


def test_a_file_that_the_system_cannot_read_is_named(tmp_path) -> None:
    """The memory of a process is a regular file, which cannot be read at its beginning, as one of a failing disk."""
    if not Path("/proc/self/mem").exists():
        pytest.skip("Linux alone has such a file")
    (tmp_path / "board0.csv").symlink_to("/proc/self/mem")
    with pytest.raises(InputError, match=r"board0\.csv: .*cannot be read: Input/output error$"):
        list(CsvFile(tmp_path / "board0.csv", ["t_s"]))


def test_a_name_with_a_zero_byte_is_no_file() -> None:
    with pytest.raises(InputError, match="cannot be read: embedded null byte"):
        check_regular(Path("a\0b"))


@pytest.mark.parametrize("name", ["../board0.csv", "/etc/passwd", "a/../../b.csv", "..\\\\b.csv", "C:b.csv", ""])
@pytest.mark.parametrize("old", ['file = "board0.csv"', 'file = "truth.csv"', 'loads = "loads.csv"'])
def test_names_in_trial_toml_do_not_lead_out_of_it(trial_copy, name, old) -> None:
    trial = trial_copy(trial=lambda text: text.replace(old, f'{old.partition(" ")[0]} = "{name}"'))
    ended = refusal_of("reconstruct", trial, cwd=trial.parent)
    assert "expected a file in the directory of this one, or below it" in ended


@pytest.mark.parametrize("name", ["../bag", "/tmp", ".."])
def test_the_bag_of_lengths_does_not_lead_out_of_the_trial(trial_copy, name) -> None:
    trial = trial_copy(trial=lambda text: f'{text[: text.index("[[board]]")]}\n[lengths]\nfile = "{name}"\n')
    ended = refusal_of("reconstruct", trial, cwd=trial.parent)
    assert "lengths.file: " in ended
    assert "expected a file in the directory of this one, or below it" in ended


def test_a_device_is_not_hashed() -> None:
    with pytest.raises(InputError, match=r"/dev/zero: expected a file, got a device or a socket"):
        sha256_of(Path("/dev/zero"))


def test_a_pipe_beside_the_files_of_a_bag_is_not_waited_for(tmp_path) -> None:
    (tmp_path / "bag").mkdir()
    os.mkfifo(tmp_path / "bag" / "pipe.db3")
    with pytest.raises(InputError, match=r"pipe\.db3: expected a file, got a pipe"):
        sha256_of(tmp_path / "bag")


def test_a_link_in_a_trial_may_lead_out_of_it(trial_copy) -> None:
    trial = trial_copy()
    (trial / "truth.csv").rename(trial.parent / "elsewhere.csv")
    (trial / "truth.csv").symlink_to("../elsewhere.csv")
    ended = printed_by("reconstruct", trial, "--method", "least-squares", "--figures", "none", cwd=trial.parent)
    assert "node RMSE" in ended
