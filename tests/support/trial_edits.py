"""Edits of the files of a trial, for `trial_copy`."""


def lines(edit):
    """An edit of a file's list of lines."""
    return lambda text: "".join(edit(text.splitlines(keepends=True)))


def cell(row: int, column: int, value: str):
    """An edit of one cell; row 1 is the header."""

    def edit(rows):
        cells = rows[row - 1].rstrip("\n").split(",")
        cells[column] = value
        rows[row - 1] = ",".join(cells) + "\n"
        return rows

    return lines(edit)


def replaced(old: str, new: str):
    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new)

    return edit
