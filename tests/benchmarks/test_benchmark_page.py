"""The command that writes the benchmark page: every part, whole tables, and never silently of two sources."""

import re
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "benchmark_page.py"

LINKED = {
    "Loads, and honesty by regime",
    "Dead sensors and wrong mechanics",
    "The sensor model on recordings held out",
    "Real strips",
    "The twin's sensors with other constants",
}
"""Headings that other pages link to."""


def write(page: Path, *arguments: object) -> str:
    """Run the command in a process of its own, and return the page."""
    command = [sys.executable, SCRIPT, "--page", page, *arguments]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return page.read_text()


@pytest.fixture
def main(monkeypatch: pytest.MonkeyPatch) -> Callable[[list[str]], None]:
    """The command in this process."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setattr(sys, "path", [*sys.path])
    return runpy.run_path(str(SCRIPT))["main"]


@pytest.fixture(scope="module")
def short_trial(tmp_path_factory, example) -> Path:
    """The first three seconds of the example trial."""
    folder = tmp_path_factory.mktemp("trials") / "short"
    folder.mkdir()
    for source in example.iterdir():
        lines = source.read_text().splitlines(keepends=True)
        (folder / source.name).write_text("".join(lines if source.suffix == ".toml" else lines[:151]))
    return folder


def assert_every_part_is_marked(text: str, absent: int) -> None:
    """Each section is inside the marks of its part, and those not made are heading and command."""
    sections = re.findall(r"<!-- part: (\S+), source \S+ -->\n## (.+?)\n(.*?)<!-- end of \1 -->\n", text, re.DOTALL)
    headings = [heading for _, heading, _ in sections]
    assert headings == re.findall(r"^## (.+)$", text, re.MULTILINE)
    assert set(headings) >= LINKED
    not_made = [body for _, _, body in sections if "|---" not in body and "| ---" not in body]
    assert len(not_made) == text.count(", source none -->") == absent
    for body in not_made:
        assert re.fullmatch(r"\nNot measured in this run: `(python|tensegraph) .+`\n", body), body


ROWS = {
    "methods": "| graph, batch | ",
    "loads": "| short | 0.",
    "front-end": "| trial | RMSE | about | static RMSE |",
    "held-out": "| stretch_0.05_s0 | LSTM | 0.00",
}
"""Parts that a short trial is enough for, and what a row of each begins with."""


@pytest.mark.parametrize("names", [("loads", "held-out"), pytest.param(tuple(ROWS), marks=pytest.mark.long)])
def test_parts_are_made_one_by_one_and_stay(names: tuple[str, ...], short_trial: Path, tmp_path: Path, main) -> None:
    """Some parts; then one of them alone, which leaves the others as they stand."""
    page = tmp_path / "benchmarks.md"
    text = write(page, "--trials", short_trial, *(word for name in names for word in ("--only", name)))
    assert re.findall(r"<!-- part: (\S+), source ([0-9a-f]{8}) -->", text) == [
        (name, re.search(r"source ([0-9a-f]{8})", text)[1]) for name in names
    ]
    assert_every_part_is_marked(text, absent=10 - len(names))
    for name in names:
        assert ROWS[name] in text, name
    assert "different sources" not in text
    tables = [block for block in text.split("\n\n") if block.startswith("|")]
    assert len(tables) == len(names) + ("methods" in names)  # which has two
    for table in tables:
        assert len({line.count("|") for line in table.splitlines()}) == 1, table
    page.write_text(re.sub(r"part: loads, source \S+", "part: loads, source 00000000", text))
    main(["--page", str(page), "--only", "held-out"])
    again = page.read_text()
    assert "Parts of this page were measured with different versions" in again
    assert_every_part_is_marked(again, absent=10 - len(names))
    for name in names[:-1]:
        assert re.search(rf"<!-- part: {name}, source \S+ -->(.*?<!-- end of {name})", text, re.DOTALL)[1] in again


def test_what_is_no_part_is_refused(tmp_path: Path, main, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--page", str(tmp_path / "page.md"), "--only", "nothing"])
    assert ended.value.code == 2
    assert "invalid choice: 'nothing'" in capsys.readouterr().err
    assert not (tmp_path / "page.md").exists()
