"""`help` of values says their fields."""

import pydoc
from dataclasses import dataclass

import tensegraph as tg
from tensegraph.models.values.field_help import describe_fields


def test_help_of_a_public_value_has_the_texts_of_its_fields() -> None:
    text = pydoc.plain(pydoc.render_doc(tg.Shape))
    assert "covariance_m2: (3 nodes, 3 nodes) covariance of all coordinates, ordered by node." in text
    assert "status: Status" in text  # a field without a text has its type


def test_settings_are_described_with_the_tables_they_hold() -> None:
    assert "rod_m: Standard deviation of a rod's length." in str(type(tg.Settings().noise).__doc__)


def test_a_class_without_source_has_the_types() -> None:
    """As one that is typed in at Python's prompt."""
    typed: dict[str, type] = {}
    exec("class Typed:\n    '''Typed in.'''\n    length_m: float", {}, typed)
    described = dataclass(typed["Typed"])
    describe_fields(described)
    assert described.__doc__ == "Typed in.\n\nFields:\n    length_m: float\n"


def test_only_dataclasses_change() -> None:
    before = tg.open_trial.__doc__
    describe_fields(tg.open_trial)
    assert tg.open_trial.__doc__ == before
