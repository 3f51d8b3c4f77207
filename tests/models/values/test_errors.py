"""Errors as a user reads them: with the file that they are of."""

from pathlib import Path

import pytest

from tensegraph import InputError
from tensegraph.models.values.errors import naming


@pytest.mark.parametrize(
    ("path", "text", "told"),
    [
        ("a", "a mark: expected one", "a: a mark: expected one"),
        ("trial", "the first readings of trial 1", "trial: the first readings of trial 1"),
        ("trial", "trial_2: expected none", "trial: trial_2: expected none"),
        ("trial", "trial: has no truth", "trial: has no truth"),
        ("trial", "trial/board0.csv: row 3", "trial/board0.csv: row 3"),
        ("trial", "m.checkpoint: cannot be written", "m.checkpoint: cannot be written"),
    ],
)
def test_a_file_is_named_where_an_error_begins_with_none(path: str, text: str, told: str) -> None:
    with pytest.raises(InputError) as refused, naming(Path(path), Path("m.checkpoint")):
        raise InputError(text)
    assert str(refused.value) == told
