"""A bar that tells the truth: never full before the end, with the time left at the mean pace."""

import io

import pytest
from rich.console import Console
from rich.progress import Progress

from tensegraph.io.reports.progress import StageBar, TimeLeft
from tensegraph.io.reports.terminal import Terminal


@pytest.fixture
def clock():
    return [0.0]


@pytest.fixture
def display(clock):
    return Progress(TimeLeft(), console=Console(file=io.StringIO()), get_time=lambda: clock[0])


def test_the_stages_of_a_bar_by_hand(display, clock) -> None:
    """Shares 1, 2 and 1: half of the second stage is half of all; 10 s for it leave 10 s."""
    bar = StageBar(display, "trial", {"reading": 1.0, "optimisation": 2.0, "figures": 1.0})
    (task,) = display.tasks
    assert TimeLeft().render(task).plain == "-:--:-- left"
    assert list(bar.track("reading", "abcd", total=4)) == list("abcd")
    assert (task.completed, task.total) == (1.0, 4.0)
    clock[0] = 10.0
    bar.reached("optimisation", 0.5)
    assert task.description == "trial: optimisation"
    assert task.completed == 2.0
    assert TimeLeft().render(task).plain == "0:00:10 left"
    clock[0] = 40.0
    bar.reached("figures", 1.0)
    assert task.finished
    assert TimeLeft().render(task).plain == "0:00:00 left"


def test_iterations_of_unknown_number_go_on_and_never_fill_the_stage(display) -> None:
    bar = StageBar(display, "trial", {"optimisation": 1.0, "figures": 1.0})
    (task,) = display.tasks
    done = []
    for iteration in range(1, 30):
        bar.iterated("optimisation", iteration)
        done.append(task.completed)
    assert done == sorted(set(done))
    assert done[-1] < 1.0


def test_more_items_than_were_expected_do_not_overflow(display) -> None:
    bar = StageBar(display, "trial", {"reading": 1.0, "figures": 1.0})
    assert len(list(bar.track("reading", range(7), total=3))) == 7
    assert display.tasks[0].completed == 1.0


def test_a_bar_inside_a_bar_is_in_the_same_display() -> None:
    terminal = Terminal(quiet=True)
    with terminal.progress() as outer:
        with terminal.stages("trial", {"reading": 1.0}):
            assert len(outer.tasks) == 1
        assert not outer.tasks
    with terminal.progress() as other:
        assert other is not outer
