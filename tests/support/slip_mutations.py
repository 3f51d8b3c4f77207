"""A second kind of hostile copies: slips that keep a file plausible, and its text odd in ways that editors hide.

The first kind, in `mutations.py`, breaks one value or the file. Here values change places, arrays lose one element,
units slip in several keys at once, two files are mixed, and characters look like others.
"""

import random
import re
from collections.abc import Callable
from functools import wraps
from math import isfinite
from pathlib import Path

from toml_slips import FACTORS, TOML

NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]?\d+)?(?![\w.])", re.ASCII)
ODD_NUMBERS = (
    *("1e400", "5e-324", "1.7976931348623157e308", "1e-12", "1e12", "-0.0", "+1", ".5", "5.", "1e5", "infinity"),
    *("-nan", "NaN", "١٢", "０.３", "²", "1__0", "0x1F", "1e+", "9" * 5000, "true", "False", "2026-01-01", "12:30:00"),
    *("", "None", "null", "#N/A", "1 000", "1'000", "−1", "3.0", "65535", "65536", "4294967296", "-32768"),
)
Change = Callable[[str, random.Random], str | bytes]
Cells = list[list[str]]


def slip(path: Path, rng: random.Random, other: Path | None = None) -> str:
    """Change a file once, twice or three times, and return the names of the changes.

    Args:
        path: of the file.
        rng: that draws the changes.
        other: a file of another kind, of which parts are mixed in.
    """
    names = []
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        try:
            text = path.read_bytes().decode()
        except UnicodeDecodeError:
            change: Callable[..., str | bytes] = rng.choice(BINARY)
            result = change(path.read_bytes(), rng)
        else:
            change = rng.choice((*TEXT, *TOML) if path.suffix == ".toml" else TABLE)
            if other is not None and rng.random() < 0.04:
                change = mixed
                result = mixed(text, other.read_text(errors="replace"), rng)
            else:
                result = change(text, rng)
        path.write_bytes(result if isinstance(result, bytes) else result.encode("utf-8", "surrogatepass"))
        names.append(change.__name__)
    return f"{path.name}: {', '.join(names)}"


def with_token(text: str, rng: random.Random, change: Callable[[str], str]) -> str:
    """Return a text with one of its numbers changed."""
    tokens = list(NUMBER.finditer(text))
    if not tokens:
        return text
    token = rng.choice(tokens)
    return text[: token.start()] + change(token.group()) + text[token.end() :]


def number_odd(text: str, rng: random.Random) -> str:
    return with_token(text, rng, lambda _: rng.choice(ODD_NUMBERS))


def number_scaled(text: str, rng: random.Random) -> str:
    return with_token(text, rng, lambda token: repr(float(token) * rng.choice(FACTORS)))


def number_next(text: str, rng: random.Random) -> str:
    """A number of a node, a tendon or a row that is one off, or the last digit that is."""
    return with_token(text, rng, lambda token: token[:-1] + "1234567890."["0123456789.".index(token[-1])])


def digits_transposed(text: str, rng: random.Random) -> str:
    return with_token(text, rng, lambda token: token[1:2] + token[:1] + token[2:])


def digit_doubled(text: str, rng: random.Random) -> str:
    return with_token(text, rng, lambda token: token[:1] + token)


def decimal_comma(text: str, rng: random.Random) -> str:
    return with_token(text, rng, lambda token: token.replace(".", ","))


def numbers_exchanged(text: str, rng: random.Random) -> str:
    tokens = list(NUMBER.finditer(text))
    if len(tokens) < 2:
        return text
    a, b = sorted(rng.sample(range(len(tokens)), 2))
    a, b = tokens[a], tokens[b]
    return text[: a.start()] + b.group() + text[a.end() : b.start()] + a.group() + text[b.end() :]


def lines_exchanged(text: str, rng: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    if len(lines) > 1:
        a, b = rng.sample(range(len(lines)), 2)
        lines[a], lines[b] = lines[b], lines[a]
    return "".join(lines)


def block_doubled(text: str, rng: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    a, b = sorted((rng.randrange(len(lines) + 1), rng.randrange(len(lines) + 1)))
    return "".join([*lines[:b], *lines[a:b], *lines[b:]])


def file_doubled(text: str, rng: random.Random) -> str:
    return text + text


def cut_in_a_row(text: str, rng: random.Random) -> str:
    return text[: rng.randrange(len(text) + 1)] + "\n"


def middle_lost(text: str, rng: random.Random) -> str:
    a, b = sorted((rng.randrange(len(text) + 1), rng.randrange(len(text) + 1)))
    return text[:a] + text[b:]


def odd_character(text: str, rng: random.Random) -> str:
    """Spaces that are none, ends of line that only Python sees, marks that editors hide."""
    at = rng.randrange(len(text) + 1)
    odd = rng.choice("\u00a0\u200b\ufeff\u2028\u2029\x85\x0b\x0c\x1c\x1a\x00\t;'\"\\#[]{}=,\u202e\ud800\r\n")
    return text[:at] + odd * rng.choice((1, 1, 3)) + text[at:]


def character_replaced(text: str, rng: random.Random) -> str:
    old, new = rng.choice(((",", ";"), (",", "\t"), (",", ", "), (".", ","), ("\n", "\n\n"), ("\n", " \n"), ("_", "-")))
    return text.replace(old, new)


def ends_mixed(text: str, rng: random.Random) -> str:
    return "".join(line + rng.choice(("\n", "\r\n", "\r")) for line in text.splitlines())


def letter_case(text: str, rng: random.Random) -> str:
    return rng.choice((str.upper, str.title, str.swapcase))(text)


def mixed(text: str, other: str, rng: random.Random) -> str:
    """Two files in one: one after the other, the end of one replaced, or rows in turn."""
    lines, others = text.splitlines(keepends=True), other.splitlines(keepends=True)
    half = rng.randrange(len(lines) + 1)
    in_turn = [line for pair in zip(lines, others, strict=False) for line in pair]
    return "".join(rng.choice(([*lines, *others], [*others, *lines], [*lines[:half], *others[half:]], in_turn)))


def of_cells(change: Callable[[Cells, random.Random], Cells]) -> Change:
    """Make of a change of rows of cells one of the text of a table, whose header stays."""

    @wraps(change)
    def change_of_text(text: str, rng: random.Random) -> str:
        header, *rows = text.splitlines() or [""]
        return "\n".join([header, *(",".join(cells) for cells in change([row.split(",") for row in rows], rng)), ""])

    return change_of_text


def columns_of(rows: Cells, count: int, rng: random.Random) -> list[int]:
    """Return different columns that every row has; where there are too few, the first one as often."""
    width = min(map(len, rows), default=0)
    return rng.sample(range(width), count) if width >= count else [0] * count


@of_cells
def columns_exchanged(rows: Cells, rng: random.Random) -> Cells:
    """The cells change places, the header stays."""
    a, b = columns_of(rows, 2, rng)
    for row in rows:
        row[a], row[b] = row[b], row[a]
    return rows


@of_cells
def column_copied(rows: Cells, rng: random.Random) -> Cells:
    a, b = columns_of(rows, 2, rng)
    for row in rows:
        row[a] = row[b]
    return rows


@of_cells
def column_late(rows: Cells, rng: random.Random) -> Cells:
    """One column a few rows later than the others."""
    late = rng.choice((1, 5, -3))
    (column,) = columns_of(rows, 1, rng)
    cells = [row[column] for row in rows]
    for k, row in enumerate(rows):
        row[column] = cells[(k - late) % len(rows)]
    return rows


@of_cells
def some_columns_set(rows: Cells, rng: random.Random) -> Cells:
    """Several columns dead, saturated or blank at once, from a row on."""
    width = min(map(len, rows), default=0)
    value = rng.choice(("0", "1023", "", "nan", "1", "0.0", "-1", "1e6", "1e-6", "512"))
    columns = [c for c in range(1, width) if rng.random() < rng.choice((0.1, 0.5, 1.0))]
    for row in rows[rng.randrange(len(rows) + 1) if rng.random() < 0.5 else 0 :]:
        for column in columns:
            row[column] = value
    return rows


@of_cells
def rows_reordered(rows: Cells, rng: random.Random) -> Cells:
    kind = rng.randrange(5)
    if kind == 0:
        return rows[::-1]
    if kind == 1:
        return rows[:: rng.choice((2, 5, 20))]
    if kind == 2:
        return [row for row in rows for _ in range(rng.choice((1, 2)))]
    if kind == 3:
        return rows[1::2] + rows[::2]
    return rows[: rng.choice((0, 1, 2, 3))]


@of_cells
def times_scaled(rows: Cells, rng: random.Random) -> Cells:
    factor, shift = rng.choice((1e3, 1e-3, 1e6, 60.0, -1.0, 0.0, 1.0)), rng.choice((0.0, 0.0, 1.7e9, -0.5, 1e7))
    for row in rows:
        if NUMBER.fullmatch(row[0]):
            row[0] = repr(float(row[0]) * factor + shift)
    return rows


@of_cells
def noise_added(rows: Cells, rng: random.Random) -> Cells:
    """All cells of one column shaken, by a share of themselves."""
    share = rng.choice((0.01, 0.3, 3.0))
    (column,) = columns_of(rows, 1, rng)
    for row in rows:
        if NUMBER.fullmatch(row[column]):
            value = float(row[column]) * (1 + share * rng.gauss(0, 1))
            row[column] = repr(value) if "." in row[column] or not isfinite(value) else repr(round(value))
    return rows


def header_odd(text: str, rng: random.Random) -> str:
    header, *rows = text.splitlines() or [""]
    names = header.split(",")
    odd = rng.choice(
        (
            [f" {name} " for name in names],
            [f'"{name}"' for name in names],
            [*names, "extra"],
            [*names, names[-1]],
            names[::-1],
            names[:-1],
            ["#" + names[0], *names[1:]],
            [name.upper() for name in names],
            ["t_s"] * len(names),
            [names[0], *names[2:], *names[1:2]],
        )
    )
    return "\n".join([",".join(odd), *rows, ""])


def decimal_commas(text: str, rng: random.Random) -> str:
    """All numbers with a comma, between semicolons or not, as a spreadsheet in a German office writes them."""
    between = rng.choice((";", "\t", ","))
    return "\n".join(between.join(cell.replace(".", ",") for cell in line.split(",")) for line in text.split("\n"))


def thousands_separated(text: str, rng: random.Random) -> str:
    separator = rng.choice((",", ".", " ", "\u00a0", "\u202f", "'", "_"))
    return NUMBER.sub(lambda found: re.sub(r"(?<=\d)(?=(\d{3})+(?!\d))", separator, found.group()), text)


def digits_local(text: str, rng: random.Random) -> str:
    """All digits of all numbers in another script."""
    zero = rng.choice("٠۰०০๐０")
    return NUMBER.sub(lambda found: re.sub(r"\d", lambda one: chr(ord(zero) + int(one.group())), found.group()), text)


def exponents_large(text: str, rng: random.Random) -> str:
    """All numbers of one magnitude that no float has."""
    exponent = rng.choice(("e400", "e-400", "e+00000000000000000001", "E308", "d3", "e99999999999999999999"))
    return NUMBER.sub(lambda found: found.group() if "e" in found.group() else found.group() + exponent, text)


def signs_odd(text: str, rng: random.Random) -> str:
    sign = rng.choice(("-", "--", "+", "+-", "\u2212"))
    return NUMBER.sub(lambda found: sign + found.group().lstrip("-"), text)


def zeros_negative(text: str, rng: random.Random) -> str:
    return re.sub(r"(?<![\w.])0(\.0+)?(?![\w.])", "-0.0", text)


def ends_with_nulls(text: str, rng: random.Random) -> str:
    """Ends of lines as of Windows, each with zero bytes, as after a crash of the file system."""
    return text.replace("\n", rng.choice(("\0\r\n", "\r\n\0", "\r\0\n", "\r\r\n")))


def header_again(text: str, rng: random.Random) -> str:
    lines = text.splitlines() or [""]
    at = rng.randrange(len(lines) + 1)
    return "\n".join([*lines[:at], lines[0], *lines[at:], ""])


def blocks_shuffled(text: str, rng: random.Random) -> str:
    """Pieces of the rows in another order, as of a recording that was put together from several files."""
    header, *rows = text.splitlines() or [""]
    size = rng.choice((2, 5, 20))
    blocks = [rows[first : first + size] for first in range(0, len(rows), size)]
    rng.shuffle(blocks)
    return "\n".join([header, *(row for block in blocks for row in block), ""])


def bits_flipped(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 4, 100)) if changed else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def word_set(data: bytes, rng: random.Random) -> bytes:
    """Two, four or eight bytes that are the ends of the range of whole numbers, or no number."""
    word = rng.choice((b"\xff\xff", b"\xff\x7f", b"\0\0\0\0", b"\xff\xff\xff\xff", b"\0\0\xc0\x7f", b"\0\0\x80\x7f",
                       b"\xff" * 8, b"\0\0\0\0\0\0\xf0\x7f"))  # fmt: skip
    at = rng.randrange(len(data) + 1) if rng.random() < 0.5 else rng.randrange(min(len(data), 600) + 1)
    return data[:at] + word + data[at + len(word) :]


def block_moved(data: bytes, rng: random.Random) -> bytes:
    a, b = sorted((rng.randrange(len(data) + 1), rng.randrange(len(data) + 1)))
    lost, doubled, zeroed = data[:a] + data[b:], data[:b] + data[a:], data[:a] + bytes(b - a) + data[b:]
    return rng.choice((lost, doubled, zeroed, data[:a]))


BINARY = (bits_flipped, word_set, block_moved)
TEXT: tuple[Change, ...] = (
    *((number_odd, number_scaled) * 3),
    *(number_next, digits_transposed, digit_doubled, decimal_comma, numbers_exchanged, lines_exchanged, block_doubled),
    *(file_doubled, cut_in_a_row, middle_lost, odd_character, odd_character, character_replaced, ends_mixed),
    *(letter_case, decimal_commas, thousands_separated, digits_local, exponents_large, signs_odd, zeros_negative),
    ends_with_nulls,
)
TABLE: tuple[Change, ...] = (
    *TEXT,
    *((columns_exchanged, column_copied, column_late, some_columns_set, rows_reordered, times_scaled, noise_added) * 2),
    *(header_odd, header_again, blocks_shuffled),
)
