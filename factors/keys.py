"""The gtsam keys of nodes: frame-major integers, so that values sorted by key have the shape (frames, nodes, 3)."""

from collections.abc import Iterable

import gtsam


def frame_keys(frame: int, node_count: int) -> range:
    """Return the keys of all nodes of a frame, in the order of the nodes."""
    return range(node_count * frame, node_count * (frame + 1))


def key_list(keys: Iterable[int]) -> gtsam.KeyList:
    """Return keys as gtsam's list type."""
    result = gtsam.KeyList()
    for key in keys:
        result.push_back(key)
    return result
