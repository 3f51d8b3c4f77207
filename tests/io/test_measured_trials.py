"""What is kept of a trial in a comparison, where the file is damaged."""

import pytest

from tensegraph.io.measured_trials import read_measured


@pytest.mark.parametrize("content", [b"", b"not an archive"])
def test_a_file_that_was_not_written_to_its_end_is_none(tmp_path, content) -> None:
    """As of a disk that was full: the trial is measured again."""
    path = tmp_path / "press_01.npz"
    path.write_bytes(content)
    assert read_measured(path, "fingerprint") is None
