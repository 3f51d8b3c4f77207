"""Linear algebra in one thread while shapes are estimated, and as before afterwards."""

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import tensegraph
from tensegraph import open_trial, stream
from tensegraph.models.values.threads import one_thread


def threads() -> set[int]:
    """The numbers of threads of the libraries of linear algebra that are loaded."""
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def three_threads():
    with threadpool_limits(limits=3, user_api="blas"):
        yield


def test_blocks_may_overlap() -> None:
    first, second = one_thread(), one_thread()
    assert threads() == {3}
    with first:
        second.__enter__()
        assert threads() == {1}
    assert threads() == {1}
    second.__exit__(None, None, None)
    assert threads() == {3}
    with pytest.raises(ZeroDivisionError), one_thread():
        np.array(1 // 0)
    assert threads() == {3}


@pytest.mark.parametrize("method", ["least-squares", "live"])
def test_shapes_are_estimated_in_one_thread(example, method, monkeypatch) -> None:
    """Whoever asks for them: while frames are read, and not before or after."""
    seen = []
    trial = open_trial(example)

    def watched():
        for row in trial.readings():
            seen.append(threads())
            if row.host_s > 0.2:
                return
            yield row

    assert len(list(stream(watched(), trial.description, method))) > 5
    assert all(now == {1} for now in seen)
    assert threads() == {3}
    unfinished = stream(trial.readings(), tensegraph.open_trial(example).description, method)
    next(unfinished)
    assert threads() == {1}
    unfinished.close()
    assert threads() == {3}
