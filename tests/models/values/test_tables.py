"""What is said of a value that does not fit: in the words of a user, with the key where it stands."""

import tomllib
from dataclasses import dataclass, field
from typing import Annotated, Literal

import pytest
from annotated_types import Ge

from tensegraph import InputError
from tensegraph.models.values.tables import FileName, Positive, parse_table


@dataclass(frozen=True, slots=True)
class Part:
    pair: tuple[int, int] = (0, 1)
    spot: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Table:
    text: str | None = None
    length_m: Positive | list[Positive] = 1.0
    channels: list[int | str] = field(default_factory=list)
    file: FileName = "a.csv"
    count: Annotated[int, Ge(1)] = 1
    frame: Literal["world", "own"] = "own"
    known: bool = True
    part: list[Part] = field(default_factory=list)
    presses: tuple[Part, ...] = ()


REFUSED = [
    ("text = true", "text: expected text between quotes, got true"),
    ("text = 2024-01-01", "text: expected text between quotes, got 2024-01-01"),
    ("text = 2024-01-01T00:00:00Z", "text: expected text between quotes, got 2024-01-01T00:00:00+00:00"),
    ("text = 07:32:00", "text: expected text between quotes, got 07:32:00"),
    ("length_m = [0.3, '0.3 m', 'x']", "length_m[1]: expected a number, got '0.3 m'"),
    ("length_m = '1e200'", "length_m: expected a number, got '1e200'"),
    ("length_m = [0.3, '0.3']", "length_m[1]: expected a number, got '0.3'"),
    ("count = true", "count: expected a number, got true"),
    ("part = [{pair = [0, true]}]", "part[0].pair[1]: expected a number, got true"),
    ("part = [{spot = {x = '1.0'}}]", "part[0].spot.x: expected a number, got '1.0'"),
    ("part = [{spot = {x = true}}]", "part[0].spot.x: expected a number, got true"),
    ("known = 'no'", "known: expected true or false, got 'no'"),
    ("known = 1", "known: expected true or false, got 1"),
    ("length_m = [0.3, -0.3]", "length_m[1]: expected a number greater than 0, got -0.3"),
    ("length_m = -1.0", "length_m: expected a number greater than 0, got -1.0"),
    ("length_m = {}", "length_m: expected a number or a list, got {}"),
    ("length_m = [1e-300]", "length_m[0]: expected at least 1e-12, got 1e-300"),
    ("channels = [0, 1.5]", "channels[1]: expected a whole number, got 1.5"),
    ("channels = [0, [1]]", "channels[1]: expected a whole number or text between quotes, got [1]"),
    ("file = '../a.csv'", "file: expected a file in the directory of this one, or below it, got '../a.csv'"),
    ("count = 0", "count: expected a number of at least 1, got 0"),
    ("count = 1e300", "count: expected a whole number, got 1e+300"),
    ("frame = 'lab'", "frame: expected 'world' or 'own', got 'lab'"),
    ("known = 'perhaps'", "known: expected true or false, got 'perhaps'"),
    ("[[part]]\npair = [0, 3, 4]", "part[0].pair: expected at most 2 values, got [0, 3, 4]"),
    ("[[part]]\npair = [0]", "part[0].pair[1]: is missing"),
    ("[[part]]\npair = 3", "part[0].pair: expected a list, got 3"),
    ("part = [3]", "part[0]: expected a table, got 3"),
    ("[[part]]\nspot = 3", "part[0].spot: expected a table, got 3"),
    ("[[part]]\nspot = { float = 'x' }", "part[0].spot.float: expected a number, got 'x'"),
    ("[presses]\npair = [0, 1]", "presses: expected a list, got {'pair': [0, 1]}"),
]


@pytest.mark.parametrize(("text", "told"), REFUSED)
def test_what_does_not_fit_is_told_in_words_of_a_user(text: str, told: str) -> None:
    with pytest.raises(InputError) as refused:
        parse_table(Table, tomllib.loads(text), "a.toml")
    assert str(refused.value) == f"a.toml: {told}"
