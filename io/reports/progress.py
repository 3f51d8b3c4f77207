"""Progress: a bar over the stages of one piece of work, and one over many pieces, with the time that is left."""

from collections.abc import Iterable, Iterator, Mapping
from datetime import timedelta
from typing import TypeVar

from rich.progress import Progress, ProgressColumn, Task
from rich.text import Text

Item = TypeVar("Item")

SLOWER = 0.6
"""Share of an optimisation that is taken to be left after one more iteration, whose number nobody knows before."""


class TimeLeft(ProgressColumn):
    """The time that is left if the rest goes on at the mean pace since the start."""

    def render(self, task: Task) -> Text:
        """Return the time left, or dashes before there is any pace."""
        if not task.completed or task.total is None or task.elapsed is None:
            return Text("-:--:-- left")
        left_s = task.elapsed * (task.total / task.completed - 1)
        return Text(f"{timedelta(seconds=max(round(left_s), 0))} left")


class StageBar:
    """One bar over all stages of a piece of work: full when the last of them is done, and never before."""

    def __init__(self, progress: Progress, name: str, share_of: Mapping[str, float]) -> None:
        """Add the bar to a display.

        Args:
            progress: the display.
            name: of the piece of work.
            share_of: the share of the whole time that each stage takes, in order; the sum need not be 1.
        """
        self._progress = progress
        self._name = name
        self._total = sum(share_of.values())
        self._share_of = dict(share_of)
        self._task = progress.add_task(name, total=self._total)

    def reached(self, stage: str, share: float) -> None:
        """Show that a share of a stage, from 0 to 1, is done; the stages before it are."""
        names = list(self._share_of)
        before = sum(self._share_of[name] for name in names[: names.index(stage)])
        done = before + min(share, 1.0) * self._share_of[stage]
        self._progress.update(self._task, completed=done, description=f"{self._name}: {stage}")

    def track(self, stage: str, items: Iterable[Item], total: int) -> Iterator[Item]:
        """Yield the items of a stage, and show how many of `total` have been taken."""
        for number, item in enumerate(items, start=1):
            yield item
            self.reached(stage, number / max(total, number))

    def iterated(self, stage: str, iteration: int) -> None:
        """Show that an iteration of an optimisation, counted from 1, is done."""
        self.reached(stage, 1 - SLOWER**iteration)

    def close(self) -> None:
        """Take the bar off the display."""
        self._progress.remove_task(self._task)
