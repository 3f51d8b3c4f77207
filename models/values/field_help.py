"""`help` of a dataclass says what its fields are: the text under each field becomes part of the class's own."""

import ast
import inspect
from dataclasses import fields, is_dataclass
from itertools import pairwise
from textwrap import dedent
from typing import Any, get_args


class FieldHelp:
    """The docstring of a dataclass, with the texts of its fields; the source is read when somebody asks for it."""

    def __init__(self, text: str) -> None:
        self._text = text

    def __get__(self, instance: object, cls: type) -> str:
        texts = _texts_of(cls)
        lines = [f"    {f.name}: {texts.get(f.name, _type_name(f.type))}" for f in fields(cls)]
        return "\n".join([inspect.cleandoc(self._text), "", "Fields:", *lines, ""])


def describe_fields(value: Any) -> None:
    """Let `help` of a dataclass, and of the dataclasses that its fields hold, describe the fields; others stay."""
    if not (isinstance(value, type) and is_dataclass(value)) or isinstance(vars(value).get("__doc__"), FieldHelp):
        return
    value.__doc__ = FieldHelp(value.__doc__ or "")  # type: ignore[assignment]
    for field in fields(value):
        for held in (field.type, *get_args(field.type)):
            describe_fields(held)


def _texts_of(cls: type) -> dict[str, str]:
    """Return the text under each field of a class, on one line; none where there is no source."""
    try:
        statements = ast.parse(dedent(inspect.getsource(cls))).body[0]
    except (OSError, TypeError):  # inspect's words for a class without a file
        return {}
    assert isinstance(statements, ast.ClassDef), f"{cls} is a class"
    return {
        field.target.id: " ".join(text.value.value.split())
        for field, text in pairwise(statements.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }


def _type_name(kind: Any) -> str:
    return kind.__name__ if isinstance(kind, type) and not get_args(kind) else str(kind).replace("typing.", "")
