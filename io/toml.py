"""TOML files into mappings."""

import tomllib
from pathlib import Path
from typing import Any

from ..models.errors import InputError
from ..models.settings import Settings
from ..models.tables import parse_table, unknown_keys


def read_toml(path: Path) -> dict[str, Any]:
    """Return a TOML file's contents.

    Raises:
        InputError: when it is missing or not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: can not be read as TOML: {error}") from error


def read_settings(path: Path | None) -> Settings:
    """Return the settings of a configuration file, or the defaults.

    Raises:
        InputError: for a file that can not be read, a key that is no setting, or a value that can not be.
    """
    if path is None:
        return Settings()
    table = read_toml(path)
    for key in unknown_keys(Settings, table):
        raise InputError(f"{path}: {key}: is no setting; a run's run.toml lists them all")
    return parse_table(Settings, table, str(path))
