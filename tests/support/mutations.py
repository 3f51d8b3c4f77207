"""Hostile copies of the files that a user gives: one or two changes each, drawn from a seed.

The changes are those that labs make (wrong unit, cut file, lost row, edited cell) and those that nobody makes on
purpose (huge numbers, not-a-numbers, bytes that are no text).
"""

import json
import random
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from safetensors import safe_open
from safetensors.numpy import save_file

NUMBERS = ("0", "-1", "1e-300", "-4e305", "1e20", "nan", "inf", "-inf", "1e308", "9" * 400, "0.0001", "1e9", "-0.0")
CELLS = (*NUMBERS, "", " ", "x", "1,5", "0x10", "1_000", "٣", '"1"', "1e", "true", "1.5.2")
VALUES: tuple[Any, ...] = (
    *(0, -1, 1, 3, 12, 24, 10**30, 1e-300, -4e305, 1e20, 1e9, float("nan"), float("inf"), -float("inf"), 0.5),
    *("", "x", "../../etc/passwd", "/dev/zero", True, False, [], [[]], {}, [0], [0.0, 0.0, 0.0], [[0, 0, 0]]),
)
FACTORS = (1000.0, 0.001, 1e6, 1e9, -1.0, 57.29578, 10.0)

Change = Callable[[str, random.Random], str | bytes]


def mutate(path: Path, rng: random.Random) -> str:
    """Change a file once or twice, and return the names of the changes."""
    if path.suffix == ".safetensors":
        return f"{path.name}: {mutate_model(path, rng)}"
    names = []
    for _ in range(rng.choice((1, 1, 2))):
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            break
        change = rng.choice(TOML_CHANGES if path.suffix == ".toml" else CSV_CHANGES)
        result = change(text, rng)
        path.write_bytes(result if isinstance(result, bytes) else result.encode())
        names.append(change.__name__)
    return f"{path.name}: {', '.join(names)}"


def mutate_model(path: Path, rng: random.Random) -> str:
    """Change a tensor, the metadata or the bytes of a model file, and return what was changed."""
    with safe_open(path, framework="numpy") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
        metadata = dict(file.metadata())
    name, kind = rng.choice(list(tensors)), rng.choice((*TENSOR_CHANGES, *["metadata"] * 4, "bytes", "cut"))
    if kind == "metadata":
        name, metadata["tensegraph"] = _with_json_leaf(metadata["tensegraph"], rng)
    elif kind in TENSOR_CHANGES:
        tensors[name] = TENSOR_CHANGES[kind](tensors[name], rng)
    save_file(tensors, path, metadata)
    data = bytearray(path.read_bytes())
    if kind == "bytes":
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    path.write_bytes(data[: rng.randrange(len(data))] if kind == "cut" else data)
    return f"{kind} {name}"


def number_replaced(tensor: np.ndarray, rng: random.Random) -> np.ndarray:
    tensor = tensor.copy()
    tensor.flat[rng.randrange(tensor.size)] = rng.choice((0, -1, 1e-300, 1e300, 1e20, np.nan, np.inf, 1000.0))
    return tensor


TENSOR_CHANGES: dict[str, Callable[[np.ndarray, random.Random], np.ndarray]] = {
    "number": number_replaced,
    "scale": lambda tensor, rng: tensor * rng.choice((1000.0, -1.0, 0.0, 1e9, 1e100)),
    "shape": lambda tensor, rng: rng.choice((tensor.ravel(), tensor[None], tensor.T.copy(), tensor[:0], tensor[:1])),
    "type": lambda tensor, rng: tensor.astype(rng.choice(("f4", "f2", "i8", "u1", "?"))),
    "reversed": lambda tensor, rng: tensor[::-1].copy(),
}


def _with_json_leaf(text: str, rng: random.Random) -> tuple[str, str]:
    """Return the name of a changed value, and the JSON with it; seldom something that is no table."""
    if rng.random() < 0.1:
        return "all", rng.choice(("[]", "1", "null", "{", "[" * 100_000))
    table = json.loads(text)
    holder, key = rng.choice(list(_places(table, rng.random() < 0.5)))
    holder[key] = rng.choice(VALUES) if rng.random() < 0.6 else _scaled(holder[key], rng.choice(FACTORS))
    return str(key), json.dumps(table)


def value_replaced(text: str, rng: random.Random) -> str:
    return _with_leaf(text, rng, lambda _: rng.choice(VALUES))


def value_scaled(text: str, rng: random.Random) -> str:
    factor = rng.choice(FACTORS)
    return _with_leaf(text, rng, lambda value: _scaled(value, factor))


def table_scaled(text: str, rng: random.Random) -> str:
    """All numbers of one key, as a wrong unit does."""
    factor = rng.choice(FACTORS)
    return _with_leaf(text, rng, lambda value: _scaled(value, factor), whole_key=True)


def key_removed(text: str, rng: random.Random) -> str:
    return _with_leaf(text, rng, lambda _: _REMOVED, whole_key=True)


def key_repeated(text: str, rng: random.Random) -> str:
    lines = text.splitlines(keepends=True) or [""]
    line = rng.choice(lines)
    lines.insert(rng.randrange(len(lines) + 1), line)
    return "".join(lines)


def cell_replaced(text: str, rng: random.Random) -> str:
    return _with_cell(text, rng, lambda _: rng.choice(CELLS))


def cell_scaled(text: str, rng: random.Random) -> str:
    factor = rng.choice(FACTORS)
    return _with_cell(text, rng, lambda cell: _scaled_cell(cell, factor))


def column_replaced(text: str, rng: random.Random) -> str:
    value = rng.choice(CELLS)
    return _with_column(text, rng, lambda _: value)


def column_scaled(text: str, rng: random.Random) -> str:
    factor = rng.choice(FACTORS)
    return _with_column(text, rng, lambda cell: _scaled_cell(cell, factor))


def all_scaled(text: str, rng: random.Random) -> str:
    """All columns but the first, as positions in millimetres are."""
    factor = rng.choice(FACTORS)
    header, *rows = text.splitlines() or [""]
    scaled = [",".join([c if k == 0 else _scaled_cell(c, factor) for k, c in enumerate(r.split(","))]) for r in rows]
    return "\n".join([header, *scaled]) + "\n"


def time_jumps(text: str, rng: random.Random) -> str:
    jump_s = rng.choice((1e9, -1e9, 1e5, 100.0, -1.0, 1e18, 0.5))
    header, *rows = text.splitlines() or [""]
    from_row = rng.randrange(len(rows) + 1)
    moved = [_first_cell(row, lambda t: t + jump_s) if k >= from_row else row for k, row in enumerate(rows)]
    return "\n".join([header, *moved]) + "\n"


def time_stands(text: str, rng: random.Random) -> str:
    header, *rows = text.splitlines() or [""]
    return "\n".join([header, *(_first_cell(row, lambda _: 1.0) for row in rows)]) + "\n"


def header_renamed(text: str, rng: random.Random) -> str:
    header, *rows = text.splitlines() or [""]
    names = header.split(",")
    names[rng.randrange(len(names))] = rng.choice(("", "t_s", "x", names[0], names[-1]))
    return "\n".join([",".join(names), *rows]) + "\n"


def columns_exchanged(text: str, rng: random.Random) -> str:
    header, *rows = text.splitlines() or [""]
    names = header.split(",")
    a, b = rng.randrange(len(names)), rng.randrange(len(names))
    names[a], names[b] = names[b], names[a]
    return "\n".join([",".join(names), *rows]) + "\n"


def lines_shuffled(text: str, rng: random.Random) -> str:
    header, *rows = text.splitlines() or [""]
    rng.shuffle(rows)
    return "\n".join([header, *rows]) + "\n"


def lines_removed(text: str, rng: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    first = rng.randrange(len(lines) + 1)
    del lines[first : first + rng.choice((1, 3, 50, len(lines)))]
    return "".join(lines)


def lines_repeated(text: str, rng: random.Random) -> str:
    lines = text.splitlines(keepends=True) or [""]
    first = rng.randrange(len(lines))
    here = rng.randrange(len(lines) + 1)
    lines[here:here] = lines[first : first + rng.choice((1, 10))]
    return "".join(lines)


def cut_off(text: str, rng: random.Random) -> str:
    return text[: rng.randrange(len(text) + 1)]


def with_bom(text: str, rng: random.Random) -> str:
    return "\ufeff" + text


def with_windows_ends(text: str, rng: random.Random) -> str:
    return text.replace("\n", "\r\n")


def with_old_mac_ends(text: str, rng: random.Random) -> str:
    return text.replace("\n", "\r")


def as_utf16(text: str, rng: random.Random) -> bytes:
    return text.encode("utf-16")


def bytes_changed(text: str, rng: random.Random) -> bytes:
    data = bytearray(text.encode())
    for _ in range(rng.choice((1, 5, 100))):
        if data:
            data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def with_long_line(text: str, rng: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    lines.insert(rng.randrange(len(lines) + 1), "1," * 500_000 + "\n")
    return "".join(lines)


def with_null_bytes(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + "\0" * 10 + text[at:]


def emptied(text: str, rng: random.Random) -> str:
    return ""


ANY: tuple[Change, ...] = (
    *(lines_removed, lines_repeated, cut_off, with_bom, with_windows_ends, with_old_mac_ends, as_utf16, bytes_changed),
    *(with_long_line, with_null_bytes, emptied),
)
TOML_CHANGES: tuple[Change, ...] = (
    *((value_replaced, value_scaled, table_scaled, key_removed) * 6),
    *(key_repeated, *ANY),
)
CSV_CHANGES: tuple[Change, ...] = (
    *((cell_replaced, cell_scaled, column_replaced, column_scaled, all_scaled, time_jumps) * 4),
    *(time_stands, header_renamed, columns_exchanged, lines_shuffled, *ANY),
)

_REMOVED = object()


def _with_leaf(text: str, rng: random.Random, change: Callable[[Any], Any], *, whole_key: bool = False) -> str:
    """Return TOML with one value changed: that of a key, or one number deep in its lists."""
    try:
        table = tomllib.loads(text)
        places = list(_places(table, whole_key))
        if places:
            holder, key = rng.choice(places)
            value = change(holder[key])
            if value is _REMOVED:
                del holder[key]
            else:
                holder[key] = value
        return tomli_w.dumps(table)
    except (ValueError, TypeError, OverflowError):
        return text


def _places(table: Any, whole_key: bool) -> Any:
    items = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in items:
        if isinstance(value, dict) or (isinstance(value, list) and value and isinstance(value[0], dict)):
            yield from _places(value, whole_key)
        else:
            yield table, key
            if isinstance(value, list) and not whole_key:
                yield from _places(value, whole_key)


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, list):
        return [_scaled(part, factor) for part in value]
    return value * factor if isinstance(value, (int, float)) and not isinstance(value, bool) else value


def _scaled_cell(cell: str, factor: float) -> str:
    try:
        return repr(float(cell) * factor)
    except ValueError:
        return cell


def _with_cell(text: str, rng: random.Random, change: Callable[[str], str]) -> str:
    lines = text.splitlines()
    row = rng.randrange(len(lines)) if lines else 0
    if not lines:
        return text
    cells = lines[row].split(",")
    column = rng.randrange(len(cells))
    cells[column] = change(cells[column])
    lines[row] = ",".join(cells)
    return "\n".join(lines) + "\n"


def _with_column(text: str, rng: random.Random, change: Callable[[str], str]) -> str:
    header, *rows = text.splitlines() or [""]
    column = rng.randrange(len(header.split(",")))
    changed = []
    for row in rows:
        cells = row.split(",")
        if column < len(cells):
            cells[column] = change(cells[column])
        changed.append(",".join(cells))
    return "\n".join([header, *changed]) + "\n"


def _first_cell(row: str, change: Callable[[float], float]) -> str:
    first, *rest = row.split(",")
    try:
        return ",".join([repr(change(float(first))), *rest])
    except ValueError:
        return row
