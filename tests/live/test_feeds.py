"""Where live readings come from."""

import pytest

import tensegraph
from tensegraph.live.rig import Rig


def test_a_rig_without_boards_is_refused(rig) -> None:
    text = rig.read_text()
    rig.write_text(text[: text.index("[[board]]")] + '[lengths]\nfile = "lengths.csv"\n')
    with pytest.raises(tensegraph.InputError, match=r"rig has boards: expected \[\[board\]\], got \[lengths\]"):
        Rig.read(rig)
