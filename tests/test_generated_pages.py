"""What `docs/generate.py` writes into the pages of the documentation."""

import re
import runpy
from pathlib import Path

import pytest

GENERATOR = Path(__file__).parents[1] / "docs" / "generate.py"


def test_bounds_of_settings_are_words_and_numbers() -> None:
    """A check that is a function has no words; it was shown with its address in memory."""
    pytest.importorskip("mkdocs", reason="the generator needs the extra docs")
    text = runpy.run_path(str(GENERATOR))["settings_text"]()
    assert "| `rod_m` | number &gt;&nbsp;0 ≥&nbsp;1e-06 | `0.0002` | Standard deviation of a rod's length. |" in text
    assert " at 0x" not in text
    assert text.count("Standard deviation of a rod's length.") == 1  # once: in the table


def test_pages_say_where_their_tables_are() -> None:
    pytest.importorskip("mkdocs", reason="the generator needs the extra docs")
    line = runpy.run_path(str(GENERATOR))["UNBUILT"]
    for page in GENERATOR.parent.rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        assert (line in text) == bool(re.search(r"^<!-- (?!skip)(?!part)(?!end)", text, re.MULTILINE)), page.name
