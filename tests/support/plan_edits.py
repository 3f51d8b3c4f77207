"""The plans of the examples, and edits of their text."""

from pathlib import Path

PLANS = {path.stem: path for path in (Path(__file__).parents[2] / "examples" / "plans").glob("*.toml")}


def replaced(text: str, *edits: tuple[str, str]) -> str:
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    return text


SHORT = (("duration_s = 30.0", "duration_s = 6.0"), ("until_s = 29.0", "until_s = 6.0"))
