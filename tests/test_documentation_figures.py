"""The figures of the documentation are drawn anew by their scripts."""

import subprocess
import sys
from pathlib import Path

import pytest

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
SCRIPTS = sorted(FIGURES.glob("*.py"))


@pytest.mark.long
@pytest.mark.parametrize("script", [path for path in SCRIPTS if path.stem != "drawing"], ids=lambda path: path.stem)
def test_a_figure_is_drawn(script: Path) -> None:
    before = {path.name: path.stat().st_mtime_ns for path in FIGURES.glob("*.png")}
    subprocess.run([sys.executable, script], check=True, timeout=300)
    assert any(path.stat().st_mtime_ns > before.get(path.name, 0) for path in FIGURES.glob("*.png"))
