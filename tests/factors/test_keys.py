"""Keys of nodes."""

from tensegraph.factors.keys import frame_keys, key_list


def test_keys_are_frame_major() -> None:
    assert list(frame_keys(1, 6)) == [6, 7, 8, 9, 10, 11]
    assert key_list([1, 2]).size() == 2
