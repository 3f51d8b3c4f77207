"""Many trials: in several processes and on a cluster the same as one by one, whatever fails or is killed."""

import filecmp
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from joblib import Parallel

from command_line import SCREEN, printed_by, refusal_of, run
from deaths import Letter, write_letter
from tensegraph import InputError
from tensegraph.commands.many import Many, Workers
from tensegraph.io.provenance import fingerprint
from tensegraph.io.reports.terminal import Terminal

pytestmark = pytest.mark.usefixtures("undrawn")

FRAME = ("--method", "frame", "--figures", "none")


def without_timing(path: Path) -> str:
    """run.toml without the one thing that is the clock's."""
    return re.sub(r"\nseconds = .*", "", (path / "run.toml").read_text())


def assert_same(one: Path, other: Path) -> None:
    """Every file of two results has the same bytes, but for the time in run.toml."""
    names = sorted(p.name for p in one.iterdir())
    assert sorted(p.name for p in other.iterdir()) == names
    _, different, errors = filecmp.cmpfiles(one, other, [n for n in names if n != "run.toml"], shallow=False)
    assert (different, errors) == ([], [])
    assert without_timing(one) == without_timing(other)


@pytest.fixture(scope="module")
def one_by_one(tmp_path_factory, example):
    """Four short trials, one of which has no measurements, and the results of the others made one by one."""
    folder = tmp_path_factory.mktemp("many")
    for k, name in enumerate("abcd"):
        (folder / name).mkdir()
        for source in example.iterdir():
            lines = source.read_text().splitlines(keepends=True)
            (folder / name / source.name).write_text("".join(lines if source.suffix == ".toml" else lines[: 41 + k]))
    (folder / "c" / "board1.csv").unlink()
    result = run("reconstruct", *"abcd", *FRAME, "--out", "one", cwd=folder)
    assert result.returncode == 1
    assert result.stderr.splitlines() == [
        "tensegraph: c/board1.csv: no such file",
        "tensegraph: 1 of 4 failed; the same command tries them again",
    ]
    assert sorted(p.name for p in (folder / "one").iterdir()) == ["a", "b", "d"]
    return folder


def loky_workers(pid: int) -> list[int]:
    """The processes that work for another."""
    children = Path(f"/proc/{pid}/task/{pid}/children")
    pids = [int(word) for word in children.read_text().split()] if children.exists() else []
    return [p for p in pids if b"popen_loky" in Path(f"/proc/{p}/cmdline").read_bytes()]


def test_a_killed_worker_loses_nothing_and_again_does_what_is_missing(one_by_one) -> None:
    folder = one_by_one
    words = ["reconstruct", *"abd", *FRAME, "--out", "two", "--jobs", "2"]
    command = [sys.executable, "-m", "tensegraph", *words]
    process = subprocess.Popen(command, cwd=folder, env=os.environ | SCREEN, stdout=subprocess.PIPE, text=True)
    while not (finished := list((folder / "two").glob("*/run.toml"))):
        assert process.poll() is None
        time.sleep(0.01)
    kept = {path: path.stat().st_mtime_ns for path in finished}
    for worker in loky_workers(process.pid):
        os.kill(worker, signal.SIGKILL)
    said, _ = process.communicate(timeout=120)
    assert process.returncode == 0, said
    for name in "abd":
        assert_same(folder / "one" / name, folder / "two" / name)
    assert {path: path.stat().st_mtime_ns for path in finished} == kept
    made = {name: (folder / "two" / name / "run.toml").stat().st_mtime_ns for name in "abd"}
    (folder / "d" / "board0.csv").write_bytes((folder / "d" / "board0.csv").read_bytes().rstrip()[:-20])
    shutil.rmtree(folder / "two" / "b")
    again = printed_by(*words[:-2], cwd=folder)
    assert [line for line in again.splitlines() if "two/" in line] == [
        "up to date: two/a",
        "written to two/b",
        "written to two/d",
    ]
    assert (folder / "two" / "a" / "run.toml").stat().st_mtime_ns == made["a"]
    assert (folder / "two" / "d" / "run.toml").stat().st_mtime_ns != made["d"]
    (folder / "two" / "a" / "lengths.csv").unlink()
    assert "written to two/a" in run(*words[:-2], cwd=folder).stdout  # a table of it was gone


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_is_stopped_takes_its_workers_with_it(one_by_one, tmp_path, number) -> None:
    words = ["reconstruct", *"abd", "--method", "frame", "--out", str(tmp_path / "out"), "--jobs", "2"]
    command = [sys.executable, "-m", "tensegraph", *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, cwd=one_by_one, env=os.environ | SCREEN, text=True, **pipes)
    while len(workers := loky_workers(process.pid)) < 2:
        assert process.poll() is None
        time.sleep(0.01)
    time.sleep(1.0)  # while joblib starts them, a signal leaves its semaphores to its tracker, which warns
    process.send_signal(number)
    _, errors = process.communicate(timeout=20)
    assert process.returncode in (1, 128 + number)
    assert "resource_tracker" not in errors
    ends = time.monotonic() + 10
    while left := [worker for worker in workers if Path(f"/proc/{worker}").exists()]:
        assert time.monotonic() < ends, left
        time.sleep(0.05)
    assert not list(tmp_path.glob("out/**/shape.csv"))


def test_a_cluster_gives_the_same_files(one_by_one, tmp_path) -> None:
    """A scheduler and two workers, each a process, of which this command knows the address alone."""
    distributed = pytest.importorskip("distributed")
    quiet = {"dashboard_address": None, "silence_logs": 50, "threads_per_worker": 1}
    with distributed.LocalCluster(n_workers=2, local_directory=tmp_path, **quiet) as cluster:
        words = ("reconstruct", *"abc", *FRAME, "--out", "dask", "--scheduler", cluster.scheduler_address)
        result = run(*words, cwd=one_by_one)
    assert result.returncode == 1
    assert "c/board1.csv: no such file" in result.stderr
    for name in "ab":
        assert_same(one_by_one / "one" / name, one_by_one / "dask" / name)


def test_a_job_at_which_processes_die_takes_no_other_with_it(tmp_path, capsys) -> None:
    """The process of `c` dies at its first attempt, while `b` waits; that of `b` dies at each."""
    texts = {"a": "one", "b": "dies", "c": "dies once", "d": "fails", "e": "is broken", "f": "two", "g": "three"}
    many = Many(Workers(2), Terminal(quiet=True))
    jobs = {name: Letter(tmp_path / name, text) for name, text in texts.items()}
    jobs["b"] = replace(jobs["b"], after=tmp_path / "c.try0")
    pids = dict(many.each(write_letter, jobs, "letters"))
    assert sorted(pids) == ["a", "c", "f", "g"]
    assert os.getpid() not in pids.values()
    assert {name: (tmp_path / name).read_text() for name in pids} == {name: texts[name] for name in pids}
    with pytest.raises(SystemExit) as ended:
        many.end()
    assert ended.value.code == 1
    said = capsys.readouterr().err
    assert "b: its process died" in said
    assert "tensegraph: d: expected a letter" in said
    assert "e: ZeroDivisionError: by zero" in said
    assert "3 of 7 failed" in said


def test_no_more_processes_are_asked_for_than_there_are_jobs(tmp_path, monkeypatch) -> None:
    """A million of them for two jobs: each would have been started."""
    asked: list[int] = []

    class Counted(Parallel):
        def __init__(self, n_jobs: int, **options) -> None:
            asked.append(n_jobs)
            super().__init__(n_jobs=n_jobs, **options)

    monkeypatch.setattr("tensegraph.commands.many.Parallel", Counted)
    many = Many(Workers(1_000_000), Terminal(quiet=True))
    made = dict(many.each(write_letter, {name: Letter(tmp_path / name, "text") for name in "ab"}, "letters"))
    assert (sorted(made), asked) == (["a", "b"], [2])


def test_one_job_is_done_here_and_its_error_is_the_command_s(tmp_path) -> None:
    many = Many(Workers(4), Terminal(quiet=True))
    assert dict(many.each(write_letter, {"a": Letter(tmp_path / "a", "text")}, "letters")) == {"a": os.getpid()}
    with pytest.raises(InputError, match="expected a letter"):
        dict(many.each(write_letter, {"b": Letter(tmp_path / "b", "fails")}, "letters"))


def test_a_worker_with_other_code_is_refused(tmp_path, monkeypatch) -> None:
    """What it would make has another fingerprint than what is made here."""
    before = fingerprint({"inputs": 1})
    monkeypatch.setattr("tensegraph.commands.many.code_hash", iter(["here", "there"] * 2).__next__)
    many = Many(Workers(1), Terminal(quiet=True))
    jobs = {name: Letter(tmp_path / name, "text") for name in "ab"}
    assert dict(many.each(write_letter, jobs, "letters")) == {}
    assert not any(tmp_path.iterdir())
    monkeypatch.setattr("tensegraph.io.provenance.code_hash", lambda: "other code")
    assert fingerprint({"inputs": 1}) != before


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--jobs", "2", "--scheduler", "tcp://x:1"), "--jobs and --scheduler: expected one of them, got both"),
        (("--scheduler", "nonsense://x"), "--scheduler: expected tcp://HOST:PORT, got 'nonsense://x'"),
        (("--scheduler", ""), "--scheduler: expected a value after it, got an empty one"),
        (("--scheduler", "tcp://x:65536"), "--scheduler: expected tcp://HOST:PORT, got 'tcp://x:65536'"),
    ],
)
def test_workers_that_cannot_be_are_one_line(one_by_one, options, message) -> None:
    assert message in refusal_of("reconstruct", *"ab", *FRAME, "--out", "none", *options, cwd=one_by_one)
    assert not (one_by_one / "none").exists()


def test_a_cluster_without_its_library_says_what_to_install(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    many = Many(Workers(scheduler="tcp://127.0.0.1:1"), Terminal(quiet=True))
    with pytest.raises(InputError, match=r"--scheduler needs distributed: pip install 'tensegraph\[cluster\]'"):
        list(many.each(write_letter, {"a": Letter(Path("a"), "text")}, "letters"))


def test_a_comparison_keeps_what_was_finished(one_by_one) -> None:
    """A trial that fails is said; of the others one table, made from the files that are kept of each."""
    folder = one_by_one
    words = ("compare", *"abcd", "--method", "frame", "--method", "ukf", "--out", "comparison")
    first = run(*words, cwd=folder)
    assert first.returncode == 1
    assert "tensegraph: c/board1.csv: no such file" in first.stderr
    table = (folder / "comparison" / "comparison.csv").read_bytes()
    assert "± " in (folder / "comparison" / "comparison.md").read_text()
    (folder / "comparison" / "comparison.csv").unlink()  # as if killed before the table
    parts = {p.name: p.stat().st_mtime_ns for p in (folder / "comparison" / "trials").iterdir()}
    assert sorted(parts) == ["a.npz", "b.npz", "d.npz"]
    run(*words, cwd=folder)
    assert (folder / "comparison" / "comparison.csv").read_bytes() == table
    assert {p.name: p.stat().st_mtime_ns for p in (folder / "comparison" / "trials").iterdir()} == parts
