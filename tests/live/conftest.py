"""What tests of live sessions share."""

from pathlib import Path

import pytest


@pytest.fixture
def rig(tmp_path, example) -> Path:
    """The example rig, in the test's folder."""
    path = tmp_path / "rig.toml"
    path.write_text((example.parent / "rig.toml").read_text())
    return path
