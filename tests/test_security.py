"""No code of ours runs what a file says, listens to the network, or writes where others can put a trap."""

import ast
import re
import runpy
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from import_graph import modules
from installed import install

ROOT = Path(__file__).parents[1]
SCRIPTS = ("benchmarks", "docs", "examples")
MODULES = [*modules(ROOT).values(), *(path for folder in SCRIPTS for path in (ROOT / folder).rglob("*.py"))]
IMPORTS = {"pickle", "marshal", "shelve", "dill", "socketserver", "http.server", "xmlrpc"}
CALLS = {
    "eval",
    "exec",
    "compile",
    "__import__",
    "os.system",
    "os.popen",
    "tempfile.mktemp",
    "joblib.load",
    "yaml.load",
}
CALLS |= {"yaml.full_load", "yaml.unsafe_load"}
ALLOWED = {"io/viewer/server.py: calls listener.bind"}
"""It looks for a free port of this machine alone, and closes it."""
LISTENING = re.compile(r"\b(serve|serve_\w+|bind|listen|start_server|create_server)$")
NEEDED = {"torch.load": ("weights_only", True)}
"""Calls that need an argument to be safe."""


def dangers(text: str) -> Iterator[str]:
    """Yield what a module must not do, with its line."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            yield from (f"{node.lineno}: imports {name}" for name in names if name in IMPORTS)
        if isinstance(node, ast.Call):
            name, arguments = ast.unparse(node.func), {k.arg: getattr(k.value, "value", None) for k in node.keywords}
            if name in CALLS or LISTENING.search(name):
                yield f"{node.lineno}: calls {name}"
            if arguments.get("shell") or arguments.get("allow_pickle"):
                yield f"{node.lineno}: {name} with shell or allow_pickle"
            if name in NEEDED and arguments.get(NEEDED[name][0]) is not NEEDED[name][1]:
                yield f"{node.lineno}: {name} without {NEEDED[name][0]}={NEEDED[name][1]}"


@pytest.mark.parametrize(
    "text",
    [
        *("import pickle", "yaml.load(text)", "import http.server", "eval('1')", "os.system('ls')"),
        *("subprocess.run('ls', shell=True)", "np.load(path, allow_pickle=True)", "torch.load(path)"),
        *("torch.load(path, weights_only=False)", "rr.serve_web()", "server.bind(('', 80))", "tempfile.mktemp()"),
    ],
)
def test_the_check_sees_it(text) -> None:
    assert list(dangers(text))


@pytest.mark.parametrize("text", ["torch.load(path, weights_only=True)", "import json", "np.load(path)", "observe(1)"])
def test_the_check_lets_pass(text) -> None:
    assert not list(dangers(text))


def test_no_module_does() -> None:
    """Examples, benchmarks and the documentation's scripts too."""
    assert len(MODULES) > 200
    found = [
        (path.relative_to(ROOT), danger.split(": ", 1)) for path in MODULES for danger in dangers(path.read_text())
    ]
    assert {f"{path}: {what}" for path, (_, what) in found} <= ALLOWED, found


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ("License-Expression: MIT OR Apache-2.0\nLicense: old words\n", "MIT OR Apache-2.0"),
        ("License: MIT License\n", "MIT"),
        ("License: UNKNOWN\nClassifier: License :: OSI Approved :: ISC License (ISCL)\n", "ISC License (ISCL)"),
        ("License: a whole\n        text\nClassifier: License :: OSI Approved :: MIT License\n", "MIT"),
    ],
)
def test_a_licence_is_that_of_the_metadata(tmp_path, monkeypatch, fields, told) -> None:
    install("some-part", "1.0", {}, tmp_path)
    with (tmp_path / "some_part-1.0.dist-info" / "METADATA").open("a") as file:
        file.write(fields)
    monkeypatch.syspath_prepend(tmp_path)
    assert script("docs/licences.py")["licence"]("some-part") == told


def test_the_page_of_licences_is_in_the_order_that_the_script_writes() -> None:
    page = (ROOT / "docs" / "reference" / "licences.md").read_text()
    told = re.findall(r"^\| ([\w-]+) \| .* \| ([\w `]+?)(?:, .*)? \|$", page, re.MULTILINE)
    assert told[1:] == list(script("docs/licences.py")["needed"]())


CLEAN = {"name": "a", "version": "1.0", "vulns": []}
UNKNOWN = {"name": "b", "skip_reason": "Dependency not found"}
HIT = {"name": "c", "version": "2.0", "vulns": [{"id": "PYSEC-1", "fix_versions": ["2.1"]}]}


@pytest.mark.parametrize(
    ("packages", "code", "line"),
    [
        ([CLEAN], 0, "1 packages, 0 known vulnerabilities"),
        ([CLEAN, HIT, UNKNOWN], 1, "c 2.0: PYSEC-1, mended in: 2.1"),
        ([CLEAN, UNKNOWN], 2, "not known to the registry: b"),
        ([UNKNOWN, UNKNOWN], 2, "the registry of vulnerabilities answers for none of 2 packages"),
    ],
)
def test_an_audit_without_an_answer_is_none(packages, code, line) -> None:
    lines, ended = script(".ci/audit.py")["report"](packages)
    assert ended == code
    assert line in lines


def test_an_audit_that_cannot_be_made_says_so_in_one_line(tmp_path, monkeypatch) -> None:
    """A registry that is not reached, and pip-audit that is not there."""
    command = [sys.executable, ROOT / ".ci" / "audit.py"]
    if find_spec("pip_audit") is None:
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (ended.returncode, ended.stdout) == (2, "pip-audit is not installed: pip install pip-audit\n")
    (tmp_path / "pip_audit.py").write_text("import sys\nsys.exit('ERROR: no connection')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    line = "the registry of vulnerabilities cannot be reached: ERROR: no connection\n"
    assert (ended.returncode, ended.stdout) == (2, line)


def script(name: str) -> dict[str, Any]:
    """Return the names that a script of the repository defines."""
    return runpy.run_path(str(ROOT / name))


def test_the_licence_of_every_dependency_is_told() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    needed = {
        re.split(r"[^\w-]", requirement)[0]
        for requirement in [*project["dependencies"], *(name for extra in extras.values() for name in extra)]
    }
    page = (ROOT / "docs" / "reference" / "licences.md").read_text()
    told = set(re.findall(r"^\| ([\w-]+) \|", page, re.MULTILINE)) - {"package"}
    assert told == needed - {"tensegraph"}
