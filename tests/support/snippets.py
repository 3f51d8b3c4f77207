"""Snippets of Markdown pages, found by sybil and run where a reader would run them.

A block of `python` shares its names with the blocks above it on the page; a block of `sh` is run by bash and has to end
well. `<!-- skip: next -->` above a block leaves it out: what flashes a board, installs, serves pages or reads boards.
"""

import os
import subprocess
from pathlib import Path

from sybil import Document, Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser, SkipParser
from sybil.parsers.markdown.lexers import FencedCodeBlockLexer

TIMEOUT_S = 300.0


def run_shell(example: Example) -> None:
    """Run a block of shell commands, and fail with what it printed."""
    command = ["bash", "-euo", "pipefail", "-c", str(example.parsed)]
    environment = os.environ | {"COLUMNS": "120", "TERM": "dumb", "MPLBACKEND": "agg"}
    quiet = {"stdin": subprocess.DEVNULL, "capture_output": True, "text": True}
    done = subprocess.run(command, env=environment, timeout=TIMEOUT_S, check=False, **quiet)
    where = f"{example.path}, line {example.line}"
    assert done.returncode == 0, f"{where}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}"


SYBIL = Sybil(parsers=[SkipParser(), PythonCodeBlockParser(), CodeBlockParser(language="sh", evaluator=run_shell)])


def parsed(page: Path) -> Document:
    """Return a page with its snippets."""
    return SYBIL.parse(page)


def run_page(page: Path) -> None:
    """Run all snippets of a page, top to bottom, in the current directory."""
    for example in parsed(page).examples():
        example.evaluate()


def languages(page: Path) -> set[str]:
    """Return the languages of all fenced blocks of a page."""
    document = Document(page.read_text(encoding="utf-8"), str(page))
    return {str(region.lexemes["language"]) for region in FencedCodeBlockLexer(language=r"[^\n]*")(document)}
