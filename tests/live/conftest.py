"""What tests of live sessions share."""

from pathlib import Path

import pytest

from plan_edits import replaced
from pty_board import PtyBoard


@pytest.fixture
def rig(tmp_path, example) -> Path:
    """The example rig, in the test's folder."""
    path = tmp_path / "rig.toml"
    path.write_text((example.parent / "rig.toml").read_text())
    return path


@pytest.fixture
def two_boards(rig, pty_boards) -> list[PtyBoard]:
    """Both boards of the rig on ptys; the rig is told not to rest, since what they send never does."""
    rig.write_text(replaced(rig.read_text(), ("seconds = 2.0", "seconds = 0.0")))
    return [pty_boards("zero", 0), pty_boards("one", 1)]


@pytest.fixture
def two_ports(two_boards) -> list[str]:
    """The words of a command line that name their ports."""
    return [word for board in two_boards for word in ("--port", str(board.port))]
