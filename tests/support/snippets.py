"""Snippets of Markdown pages, found by sybil and run where a reader would run them.

A block of `python` shares its names with the blocks above it on the page; a block of `sh` has to end well. One of
`tensegraph` commands alone runs in this process, which has imported everything already, any other in bash.
`<!-- skip: next -->` above a block leaves it out: what flashes a board, installs, serves pages or reads boards.
"""

import os
import re
import subprocess
from pathlib import Path

from sybil import Document, Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser, SkipParser
from sybil.parsers.markdown.lexers import FencedCodeBlockLexer

from command_line import run

TIMEOUT_S = 300.0
COMMAND = re.compile(r"tensegraph(?: [\w./:,=-]+)+")
"""A command without anything that a shell would replace or connect."""


def run_shell(example: Example) -> None:
    """Run a block of shell commands, and fail with what it printed."""
    lines = str(example.parsed).splitlines()
    done = map(run_here, lines) if all(map(COMMAND.fullmatch, lines)) else [run_in_bash(example)]
    where = f"{example.path}, line {example.line}"
    for ended in done:
        assert ended.returncode == 0, f"{where}: exit code {ended.returncode}\n{ended.stdout}\n{ended.stderr}"


def run_here(line: str) -> subprocess.CompletedProcess:
    """Run one `tensegraph` command in this process."""
    return run(*line.split()[1:], cwd=Path.cwd())


def run_in_bash(example: Example) -> subprocess.CompletedProcess:
    """Run a block in a shell that ends at its first error."""
    command = ["bash", "-euo", "pipefail", "-c", str(example.parsed)]
    environment = os.environ | {"COLUMNS": "120", "TERM": "dumb", "MPLBACKEND": "agg"}
    quiet = {"stdin": subprocess.DEVNULL, "capture_output": True, "text": True}
    return subprocess.run(command, env=environment, timeout=TIMEOUT_S, check=False, **quiet)


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
