"""How often Python looks for garbage."""

import gc

from tensegraph.commands.garbage import NEW_OBJECTS, rare_collections


def test_collections_are_rare_until_the_block_ends() -> None:
    usual = gc.get_threshold()
    with rare_collections():
        assert gc.get_threshold() == (NEW_OBJECTS, *usual[1:])
    assert gc.get_threshold() == usual
