"""Every Python and shell snippet of README and documentation runs, but for those marked `<!-- skip: next -->`."""

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import pytest

import undrawn_command
from blank_figures import figures_of_the_first_result
from plan_edits import PLANS, replaced
from snippets import languages, parsed, run_page
from tensegraph.pipeline import ESTIMATORS

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted({*ROOT.glob("CONTRIBUTING.md"), *(ROOT / "docs").rglob("*.md")})]
NOT_RUN = {"", "csv", "ini", "json", "matlab", "text", "toml"}
"""Languages of blocks that show something; any other than these, `python` and `sh` would escape the tests."""


@pytest.fixture
def reader(tmp_path: Path, trial_copy: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The directory of a reader: the examples, of which trial and plans are a few seconds long, and `tensegraph`.

    The figures of a page's first result are composed, and none is drawn. What a page registers is forgotten.
    """
    examples = tmp_path / "examples"
    shutil.copytree(ROOT / "examples", examples, ignore=shutil.ignore_patterns("press_01", "__pycache__"))
    trial_copy(rows=106, name="examples/press_01")
    for name, seconds in (("press", "3.0"), ("prism", "4.0")):
        plan = PLANS[name].read_text().partition("[[load.random]]")[0]
        (examples / "plans" / f"{name}.toml").write_text(
            replaced(plan, ("duration_s = 30.0", f"duration_s = {seconds}"))
        )
    command = tmp_path / "bin" / "tensegraph"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{undrawn_command.__file__}" "$@"\n')
    command.chmod(0o755)
    path = [str(command.parent), str(Path(sys.executable).parent), os.environ["PATH"]]
    monkeypatch.setenv("PATH", os.pathsep.join(path))
    monkeypatch.chdir(tmp_path)
    with figures_of_the_first_result(), mock.patch.dict(ESTIMATORS):
        yield tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_snippets_of_a_page_run(page: Path, reader: Path) -> None:
    run_page(page)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_no_snippet_escapes(page: Path) -> None:
    assert languages(page) <= NOT_RUN | {"python", "sh"}


GOOD = "# A page\n\n```python\nx = 1\n```\n\n```sh\ntest -d examples/press_01\n```\n"


def test_snippets_run_in_the_reader_s_directory(reader: Path) -> None:
    more = "```python\nassert x == 1\n```\n\n```sh\ntensegraph --help > help.txt\n```\n"
    (reader / "page.md").write_text(f"{GOOD}\n{more}")
    run_page(reader / "page.md")
    assert "reconstruct" in (reader / "help.txt").read_text()
    assert len(list(parsed(reader / "page.md").examples())) == 4


BAD = [
    "```python\nassert x == 2\n```",
    "```sh\nfalse | true\n```",
    "```sh\nexit 3\n```",
    "```sh\ntensegraph evaluate nothing\n```",
]


@pytest.mark.parametrize("bad", BAD)
def test_a_snippet_that_fails_is_seen_and_can_be_left_out(reader: Path, bad: str) -> None:
    (reader / "page.md").write_text(f"{GOOD}\n{bad}\n")
    with pytest.raises(AssertionError):
        run_page(reader / "page.md")
    (reader / "page.md").write_text(f"{GOOD}\n<!-- skip: next -->\n{bad}\n")
    run_page(reader / "page.md")


@pytest.mark.parametrize("language", ["bash", "py", "console"])
def test_a_block_in_another_language_is_seen(tmp_path: Path, language: str) -> None:
    (tmp_path / "page.md").write_text(f"{GOOD}\n1. then\n\n    ```{language}\n    false\n    ```\n")
    assert languages(tmp_path / "page.md") == {"python", "sh", language}
