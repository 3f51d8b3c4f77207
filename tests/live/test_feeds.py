"""Where live readings come from."""

import pytest

import tensegraph
from tensegraph.live.rig import Rig


def test_a_rig_without_boards_is_refused(rig) -> None:
    text = rig.read_text()
    rig.write_text(text[: text.index("[[board]]")] + '[lengths]\nfile = "lengths.csv"\n')
    with pytest.raises(tensegraph.InputError, match=r"rig has boards: expected \[\[board\]\], got \[lengths\]"):
        Rig.read(rig)


def test_a_rest_too_short_to_judge_is_refused(rig) -> None:
    rig.write_text(rig.read_text().replace("seconds = 2.0", "seconds = 0.5"))
    with pytest.raises(
        tensegraph.InputError, match=r"\[rest\] seconds: too short .*: expected 0 or at least 1, got 0.5"
    ):
        Rig.read(rig)
