"""Numbers as the text of a table's cells."""

import numpy as np


def or_dash(value: float, form: str) -> str:
    """Return a number in a form such as `{:.1f} mm`, or a dash where there is none."""
    return form.format(value) if np.isfinite(value) else "-"
