"""Plans of the twin, from TOML."""

from pathlib import Path

from ..models.twin.plan import Plan, problems
from ..models.values.errors import InputError
from ..models.values.tables import parse_table, unknown_keys
from .toml import line_of, read_toml


def read_plan(path: Path) -> Plan:
    """Return a plan that can be simulated.

    Raises:
        InputError: naming file, line and key of the first thing that cannot be.
    """
    table = read_toml(path)
    text = path.read_text(encoding="utf-8")

    def place(key: str) -> str:
        return f"{path}: line {line_of(text, key)}"

    for key in unknown_keys(Plan, table):
        raise InputError(f"{place(key)}: {key}: is no key of a plan")
    plan = parse_table(Plan, table, place)
    for key, problem in problems(plan):
        raise InputError(f"{place(key)}: {key}: {problem}")
    return plan
