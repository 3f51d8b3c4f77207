"""What the pages do not say by hand: settings and tables from their dataclasses, commands from the CLI, modules.

A hook of MkDocs. In a page, `<!-- fields: MODULE.CLASS -->` becomes a table of that dataclass: name, type, default, and
the docstring under each field; `<!-- settings -->` becomes those of `Settings` and all its parts, `<!-- commands -->`
every command with its options and examples, `<!-- statuses -->` what to do at each status of a frame,
`<!-- quantities -->` and `<!-- numbers of words -->` the quantities of a run and the numbers of words. Lines
`NAME: TEXT` inside the first comment say what a field without docstring means; a name that is no field, and a field
that is said nowhere, are warnings, which `mkdocs build --strict` refuses. The line `UNBUILT` is left out.
"""

import ast
import atexit
import importlib
import inspect
import logging
import re
import shutil
import tempfile
import textwrap
from collections.abc import Container, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
SKIPPED = {"tests", "examples", "benchmarks", "docs", "build", "dist", "site"}
"""Folders beside the package's own."""
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "models/data/stretching.md": "reference/model-card.md",
}
"""Files of the repository that are pages, so that nothing is said twice."""
PICTURES = ("examples/*.png",)
"""Their pictures, and those that pages link to as `../examples/...`."""
UNBUILT = "*Tables of this page are generated: they are in the pages that `mkdocs serve` builds, see README.*\n"
"""What pages say to those who read them unbuilt, as on GitHub."""
FIELDS = re.compile(r"<!-- fields: (?P<name>[\w.]+)(?P<notes>.*?)-->", re.DOTALL)
BASICS = {float: "number", int: "whole number", str: "text", bool: "true or false", type(None): "none"}
BOUNDS = {"gt": "&gt;", "ge": "≥", "lt": "&lt;", "le": "≤"}

log = logging.getLogger("mkdocs.hooks.generate")


@event_priority(100)  # before mkdocstrings, which reads the search path
def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the page of every module into the navigation, and say where the modules are."""
    assert config.nav is not None
    config.plugins["mkdocstrings"].config["handlers"]["python"]["paths"] = [str(copied_package())]
    rooms: dict[str, list[dict[str, str]]] = {}
    for module in modules():
        _, *room, name = module.split(".")
        if room[:1] == ["models"]:
            room = room[:2]
        else:
            room, name = room[:1], ".".join([*room[1:], name])
        rooms.setdefault(".".join(room), []).append({name: module_page(module)})
    section: list[Any] = [{room: pages} for room, pages in rooms.items() if room] + rooms.get("", [])
    reference = next(entry["Reference"] for entry in config.nav if isinstance(entry, dict) and "Reference" in entry)
    reference.append({"Modules": section})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the page of every module, and what stands elsewhere in the repository and is a page here."""
    for path, page in PAGES.items():
        files.append(File.generated(config, page, content=within_site((ROOT / path).read_text(encoding="utf-8"))))
    for path in PICTURES:
        for picture in sorted(ROOT.glob(path)):
            files.append(File.generated(config, picture.relative_to(ROOT).as_posix(), abs_src_path=str(picture)))
    for module in modules():
        text = f"---\ntitle: {module.removeprefix('tensegraph.')}\n---\n\n::: {module}\n"
        files.append(File.generated(config, module_page(module), content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Return a page with its comments replaced by what they ask for."""
    markdown = re.sub(r"\]\((?:\.\./)+examples/", f"]({'../' * page.file.src_uri.count('/')}examples/", markdown)
    markdown = markdown.replace(UNBUILT, "")
    if "<!-- settings -->" in markdown:
        markdown = markdown.replace("<!-- settings -->", settings_text())
    if "<!-- commands -->" in markdown:
        markdown = markdown.replace("<!-- commands -->", commands_text())
    if "<!-- statuses -->" in markdown:
        markdown = markdown.replace("<!-- statuses -->", statuses_table())
    if "<!-- quantities -->" in markdown:
        markdown = markdown.replace("<!-- quantities -->", quantities_table())
        markdown = markdown.replace("<!-- numbers of words -->", codes_table())
    return FIELDS.sub(lambda match: fields_table(dataclass_named(match["name"]), notes_of(match["notes"])), markdown)


def within_site(text: str) -> str:
    """Return Markdown of the repository's root with its links as they are in the site."""
    for path, page in PAGES.items():
        text = text.replace(f"]({path})", f"]({page})")
    return text.replace("](docs/", "](")


def copied_package() -> Path:
    """Return a folder that holds a copy of the package by its own name, whatever the checkout is called.

    In it io has an `__init__.py`: the reader of docstrings passes by packages without one.
    """
    folder = Path(tempfile.mkdtemp(prefix="tensegraph-docs-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    for module in modules():
        path = Path(*module.split(".")[1:]).with_suffix(".py")
        (folder / "tensegraph" / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / path, folder / "tensegraph" / path)
    for inside in [ROOT / "__init__.py", *ROOT.glob("*/**/__init__.py")]:
        if (folder / "tensegraph" / inside.relative_to(ROOT)).parent.is_dir():
            shutil.copyfile(inside, folder / "tensegraph" / inside.relative_to(ROOT))
    (folder / "tensegraph/io/__init__.py").touch()
    return folder


def modules() -> list[str]:
    """Return the names of the package's modules that define something."""
    names = []
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if any(part in SKIPPED or part.startswith((".", "_")) for part in parts):
            continue
        names.append(".".join(["tensegraph", *parts]))
    return names


def module_page(module: str) -> str:
    """Return where the page of a module stands."""
    return f"reference/modules/{module.removeprefix('tensegraph.')}.md"


def dataclass_named(name: str) -> type[Any]:
    """Return a dataclass by its full name."""
    module, _, kind = name.rpartition(".")
    found: type[Any] = getattr(importlib.import_module(module), kind)
    return found


def notes_of(text: str) -> dict[str, str]:
    """Return what the lines `NAME: TEXT` of a comment say."""
    pairs = (line.partition(":") for line in text.strip().splitlines())
    return {name.strip(): note.strip() for name, _, note in pairs}


def fields_table(kind: type[Any], notes: Mapping[str, str], left_out: Container[str] = ()) -> str:
    """Return a Markdown table of a dataclass's fields, but for some."""
    hints, said = get_type_hints(kind, include_extras=True), docstrings(kind)
    for name in notes.keys() - hints.keys():
        log.warning("%s has no field %s", kind.__qualname__, name)
    lines = ["| name | type | default | |", "|---|---|---|---|"]
    for field in fields(kind):
        if field.name in left_out:
            continue
        text = said.get(field.name) or notes.get(field.name)
        if not text:
            log.warning("%s.%s: nothing says what it is", kind.__qualname__, field.name)
        cells = (f"`{field.name}`", type_text(hints[field.name]), default_text(field), text or "")
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join(lines)


def settings_text() -> str:
    """Return a heading and a table for `Settings` and for each of its parts."""
    from tensegraph import Settings

    tables = {name: kind for name, kind in get_type_hints(Settings).items() if is_dataclass(kind)}
    parts = ["## Top level", fields_table(Settings, {}, left_out=tables)]
    for name, kind in tables.items():
        about = (inspect.getdoc(kind) or "").partition("\n\nFields:")[0]  # the table has the fields
        parts += [f"## `[{name}]`", about, fields_table(kind, {})]
    return "\n\n".join(parts)


def statuses_table() -> str:
    """Return Markdown tables of the statuses of a frame and of the reasons for doubt, each with its advice."""
    from tensegraph import Status
    from tensegraph.models.structure.shape import Reason

    statuses = [f"| `{status.value}` | {escaped(status.advice)} |" for status in Status]
    reasons = [f"| `{reason.value}` | {escaped(reason.advice)} |" for reason in Reason]
    heads = (["| status | what to make of it |", "|---|---|"], ["", "| doubt | what to make of it |", "|---|---|"])
    return "\n".join([*heads[0], *statuses, *heads[1], *reasons])


def quantities_table() -> str:
    """Return a Markdown table of the quantities of a run."""
    from tensegraph.models.structure.quantities import LABELS, QUANTITIES

    lines = ["| name | dimensions | unit | |", "|---|---|---|---|"]
    for name, quantity in QUANTITIES.items():
        unit = {"1": "", "m2": "m²"}.get(quantity.unit, quantity.unit)
        lines.append(f"| `{name}` | {', '.join(quantity.dimensions)} | {unit} | {escaped(quantity.meaning)} |")
    labels = "; ".join(f"`{name}`: {', '.join(labels)}" for name, labels in LABELS.items())
    return "\n".join([*lines, "", f"Labels of the dimensions: {labels}."])


def codes_table() -> str:
    """Return a Markdown table of the numbers of words."""
    from tensegraph.models.structure.quantities import QUANTITIES

    rows = [
        f"| `{name}` | {', '.join(f'{code} `{word}`' for code, word in quantity.codes.items())} |"
        for name, quantity in QUANTITIES.items()
        if quantity.codes
    ]
    return "\n".join(["| | |", "|---|---|", *rows])


def docstrings(kind: type[Any]) -> dict[str, str]:
    """Return the docstring under each field of a dataclass, those that it inherits included, on one line."""
    said = {}
    for part in filter(is_dataclass, reversed(kind.__mro__)):
        body = ast.parse(textwrap.dedent(inspect.getsource(part))).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, text in zip(body.body, body.body[1:], strict=False):
            match field, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                    said[name] = " ".join(words.split())
    return said


def type_text(hint: Any) -> str:
    """Return a type in words, with its bounds."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return " ".join([type_text(arguments[0]), *filter(None, map(bound_text, arguments[1:]))])
    if origin is Literal:
        return ", ".join(f"`{value!r}`".replace("'", '"') for value in arguments)
    if origin in (Union, UnionType):
        return " or ".join(type_text(argument) for argument in arguments if argument is not type(None))
    if origin is tuple:
        return f"[{', '.join(type_text(argument) for argument in arguments)}]"
    if origin is dict:
        return f"tables of any names, each a {type_text(arguments[1])}"
    if origin is not None:
        return f"list of {type_text(arguments[0])}"
    if is_dataclass(hint):
        return "table"
    return BASICS.get(hint, getattr(hint, "__name__", str(hint)))


def bound_text(bound: object) -> str:
    """Return the bounds of a number, as `annotated_types` states them; nothing for a check of another kind."""
    stated = [(sign, getattr(bound, name, None)) for name, sign in BOUNDS.items()]
    return " and ".join(f"{sign}&nbsp;{value}" for sign, value in stated if value is not None)


def default_text(field: "Field[Any]") -> str:
    """Return a field's default, as in TOML."""
    if field.default_factory is not MISSING:
        return "" if is_dataclass(field.default_factory) else "none"
    if field.default is MISSING:
        return "**required**"
    if field.default is None or field.default == ():
        return "none"
    return f"`{str(field.default).lower() if isinstance(field.default, bool) else repr(field.default)}`".replace(
        "'", '"'
    )


def commands_text() -> str:
    """Return a section for the program and for each of its commands."""
    from typer.main import get_command

    from tensegraph.cli import app

    program: Any = get_command(app)
    context = program.make_context("tensegraph", [], resilient_parsing=True)
    parts = ["## tensegraph", "Options of the program itself, before the command:", options_table(program, context)]
    for name, command in sorted(program.commands.items()):
        if not command.hidden:
            inner = command.make_context(name, [], parent=context, resilient_parsing=True)
            help_text = inspect.cleandoc(command.help or "")
            parts += [f"## {name}", help_text, options_table(command, inner), examples_text(command.epilog or "")]
    return "\n\n".join(part for part in parts if part)


def examples_text(epilog: str) -> str:
    """Return the end of a command's help: text as it is, and each run of its commands as one block."""
    parts: list[str] = []
    for paragraph in epilog.split("\n\n"):
        line = paragraph.strip()
        if line.startswith("tensegraph ") and parts and parts[-1].endswith("\n```"):
            parts[-1] = f"{parts[-1].removesuffix('```')}{line}\n```"
        else:
            parts.append(f"```text\n{line}\n```" if line.startswith("tensegraph ") else line)
    return "\n\n".join(parts)


def options_table(command: Any, context: Any) -> str:
    """Return a Markdown table of a command's arguments and options."""
    records = [parameter.get_help_record(context) for parameter in command.get_params(context)]
    rows = [f"| `{record[0]}` | {escaped(record[1])} |" for record in records if record]
    return "\n".join(["| | |", "|---|---|", *rows])


def escaped(text: str) -> str:
    """Return text that is safe in a cell of a table."""
    return re.sub(r"([|\[\]*_])", r"\\\1", " ".join(text.split())).replace("<", "&lt;")
