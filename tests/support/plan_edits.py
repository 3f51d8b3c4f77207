"""The plans of the examples, and edits of their text."""

from pathlib import Path

PLANS = {path.stem: path for path in (Path(__file__).parents[2] / "examples" / "plans").glob("*.toml")}
CAUSES = {path.stem: path for path in (PLANS["press"].parent / "causes").glob("*.toml")}


def replaced(text: str, *edits: tuple[str, str]) -> str:
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    return text


SHORT = (
    ("duration_s = 30.0", "duration_s = 6.0"),
    ("until_s = 29.0", "until_s = 6.0"),
    ("step_s = 0.001 ", "step_s = 0.002 "),
)
"""Six seconds of the press plan, in half of the steps: nodes are within 0.04 mm of where they would be."""
SHORT_REST = ("seconds = 2.0", "seconds = 1.0")
"""One second of rest in place of two, of a trial, a rig or a plan."""

DRIFT = """[drift]
from_s = 1.0
common_share = 0.01
common_course = "ramp"
of = "resistance"
own_sigma = 0.0
own_course = "ramp"
"""
"""A drift of all sensors alike; it lacks `until_s`, its last line."""
