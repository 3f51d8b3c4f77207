"""Conversion of tables (from TOML) to frozen dataclasses; a value that does not fit gives an error of one line."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from datetime import date, time
from difflib import get_close_matches
from typing import Annotated, Any, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Interval, Le
from pydantic import AfterValidator, AllowInfNan, TypeAdapter, ValidationError

from .errors import InputError
from .units import check_ranges

SMALLEST = 1e-12
"""The smallest positive number: below it, products of a few numbers are lost."""
SMALLEST_SIGMA = 1e-6
"""The least standard deviation, a micrometre or a micronewton: a factor that is a million times more certain than the
others leaves nothing of them in the digits of their sum."""


def _not_tiny(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"expected at least {SMALLEST:g}")
    return value


PositiveOrInfinite = Annotated[float, Gt(0), AfterValidator(_not_tiny)]
"""A number above zero, or infinity."""
Positive = Annotated[PositiveOrInfinite, AllowInfNan(False)]
"""A finite number above zero."""
AngularRate = Annotated[Positive, Le(35)]
"""That of a body in rad/s: up to the range of usual inertial sensors, 2000 degrees a second."""
NotNegative = Annotated[float, Ge(0), AllowInfNan(False)]
"""Zero or a finite positive number."""
Fraction = Annotated[float, Interval(ge=0, le=1)]
"""A number from 0 to 1."""
ZeroOrMore = Annotated[int, Ge(0)]
"""A whole number that is not negative."""
AtLeastOne = Annotated[int, Ge(1)]
"""A whole number, 1 or greater."""
Share = Annotated[float, Interval(ge=0, lt=1)]
"""A number from 0 up to, but not including, 1."""
Sigma = Annotated[Positive, Ge(SMALLEST_SIGMA)]
"""The standard deviation of a kind of factor."""
Probability = Annotated[float, Interval(gt=0, lt=1), AfterValidator(_not_tiny)]
"""A number strictly between 0 and 1."""

_TRUTH, _LIST, _NUMBER, _TABLE, _WHOLE = "true or false", "a list", "a number", "a table", "a whole number"
EXPECTED = {
    "bool_parsing": _TRUTH,
    "bool_type": _TRUTH,
    "dataclass_type": _TABLE,
    "dict_type": _TABLE,
    "finite_number": "a finite number",
    "float_parsing": _NUMBER,
    "float_type": _NUMBER,
    "greater_than": "a number greater than {gt:g}",
    "greater_than_equal": "a number of at least {ge:g}",
    "int_from_float": _WHOLE,
    "int_parsing": _WHOLE,
    "int_parsing_size": _WHOLE,
    "int_type": _WHOLE,
    "less_than": "a number less than {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
    "list_type": _LIST,
    "literal_error": "{expected}",
    "model_type": _TABLE,
    "string_type": "text between quotes",
    "too_long": "at most {max_length} values",
    "tuple_type": _LIST,
}
"""What was expected, by pydantic's type of error, with the names of the numbers that it gives."""


def _inside(name: str) -> str:
    if not name or "\0" in name or name.startswith(("/", "\\")) or ":" in name[:2] or ".." in re.split(r"[/\\]", name):
        raise ValueError("expected a file in the directory of this one, or below it")
    return name


FileName = Annotated[str, AfterValidator(_inside)]
"""Name of a file that does not lead out of the directory; a link that someone made there may."""

T = TypeVar("T")


def parse_table(kind: type[T], table: Mapping[str, Any], where: str | Callable[[str], str]) -> T:
    """Return the dataclass that a table describes; keys that it does not have are ignored (see `unknown_keys`).

    Args:
        kind: a dataclass, whose fields may be dataclasses themselves.
        table: names to values, as from TOML.
        where: name of the file for the error text, or a function that returns the place of a dotted key.

    Raises:
        InputError: the text names the file and the key, what was expected, and what it got.
    """
    try:
        parsed = TypeAdapter(kind).validate_python(dict(table))
        _check_types(parsed, table, "")
        check_ranges(table)
    except InputError as error:
        key, _, text = str(error).partition(": ")
        raise InputError(f"{where if isinstance(where, str) else where(key)}: {key}: {text}") from error
    except ValidationError as error:
        key, problem = _problem(error, table)
        raise InputError(f"{where if isinstance(where, str) else where(key)}: {key}: {problem}") from error
    return parsed


def _check_types(parsed: Any, given: Any, key: str) -> None:
    """Refuse a number between quotes, and true or false in place of a number or the other way round.

    Pydantic converts them: `"0.3"` would escape the check of its range.
    """
    if is_dataclass(parsed) and isinstance(given, Mapping):
        for name in (field.name for field in fields(parsed) if field.name in given):
            _check_types(getattr(parsed, name), given[name], f"{key}.{name}" if key else name)
    elif isinstance(parsed, Mapping) and isinstance(given, Mapping):
        for name in given:
            _check_types(parsed.get(name), given[name], f"{key}.{name}")
    elif isinstance(parsed, list | tuple) and isinstance(given, list | tuple):
        for index, (one, given_one) in enumerate(zip(parsed, given, strict=False)):
            _check_types(one, given_one, f"{key}[{index}]")
    elif isinstance(parsed, int | float):
        is_truth = isinstance(parsed, bool)
        if isinstance(given, str) or isinstance(given, bool) != is_truth:
            raise InputError(f"{key}: expected {_TRUTH if is_truth else _NUMBER}, got {_shortened(given)}")


def _problem(error: ValidationError, table: Mapping[str, Any]) -> tuple[str, str]:
    """Return the dotted key of the first value that does not fit, and what was expected of it."""
    found = [(_place(one, table), one) for one in error.errors()]
    first = found[0][0]
    # of a value that may be a number or a list, each choice complains: the one that came furthest was meant
    place = max((place for place, _ in found if place[: len(first)] == first), key=len)
    here = [one for other, one in found if other == place]
    meant = [one for one in here if not one["type"].endswith("_type")] or here
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place)[1:] or "the file"
    if meant[0]["type"] == "missing":
        return key, "is missing"
    complaints = list(dict.fromkeys(map(_complaint, meant)))
    expected = " or ".join([complaints[0], *(other.removeprefix("expected ") for other in complaints[1:])])
    return key, f"{expected}, got {_shortened(meant[0]['input'])}"


def _place(error: Any, table: Mapping[str, Any]) -> tuple[int | str, ...]:
    """Return the keys and indices to where an error is, without the names that pydantic gives to choices of a value."""
    place: list[int | str] = []
    value: Any = table
    for part in error["loc"]:
        is_index = isinstance(value, list | tuple) and isinstance(part, int) and part < len(value)
        if is_index or (isinstance(value, Mapping) and part in value):
            place.append(part)
            value = value[part]
    return (*place, error["loc"][-1]) if error["type"] == "missing" else tuple(place)


def _complaint(error: Any) -> str:
    if error["type"] in EXPECTED:
        return f"expected {EXPECTED[error['type']].format(**error.get('ctx', {}))}"
    if error["type"] == "value_error":  # one of ours, or of a class of another package
        return str(error["ctx"]["error"])
    return str(error["msg"]).lower()


class UnknownKey(NamedTuple):
    """A key of a table that its dataclass does not have."""

    name: str
    """Dotted."""
    similar: str | None
    """The key that may be meant."""

    @property
    def hint(self) -> str:
        """The end of a sentence that asks for the similar key; nothing without one."""
        return f": did you mean {self.similar}?" if self.similar else ""


def unknown_keys(kind: type[Any], table: Mapping[str, Any], prefix: str = "") -> Iterator[UnknownKey]:
    """Yield the keys of a table that its dataclass does not have."""
    hints = get_type_hints(kind)
    names = {field.name for field in fields(kind)}
    for key, value in table.items():
        if key not in names:
            yield UnknownKey(prefix + key, next(iter(get_close_matches(key, names, 1)), None))
            continue
        for inner in (hints[key], *get_args(hints[key])):
            if is_dataclass(inner) and isinstance(inner, type):
                for label, part in _parts(hints[key], f"{prefix}{key}", value):
                    if isinstance(part, Mapping):
                        yield from unknown_keys(inner, part, f"{label}.")


def _parts(hint: Any, key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the tables that a value holds, each with its dotted key: a list's, a table's of any names, or itself."""
    if isinstance(value, list):
        yield from ((f"{key}[{index}]", part) for index, part in enumerate(value))
    elif get_origin(hint) is dict and isinstance(value, Mapping):
        yield from ((f"{key}.{name}", part) for name, part in value.items())
    else:
        yield key, value


def _shortened(value: object) -> str:
    text = repr(value)
    if isinstance(value, date | time):  # a datetime is a date
        text = value.isoformat()
    elif isinstance(value, bool):
        text = text.lower()
    return text if len(text) <= 60 else f"{text[:57]}..."
