"""No code of ours runs what a file says, listens to the network, or writes where others can put a trap."""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = [path for path in ROOT.rglob("*.py") if not {".venv", ".types", "tests", "site"} & set(path.parts)]
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
