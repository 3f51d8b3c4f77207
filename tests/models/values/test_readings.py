"""Flags of a reading, by name."""

from tensegraph import Flag


def test_flags_by_name() -> None:
    for flags in (Flag(0), Flag.STUCK, Flag.MISSING | Flag.OUTLIER | Flag.AMBIGUOUS):
        assert Flag.of_names(flags.names()) == flags
