"""Work on many inputs: in this process, in several processes of this machine, or on a cluster."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from joblib import Parallel, delayed, parallel_config

from ..io.provenance import code_hash
from ..io.reports.terminal import Terminal
from ..models.values.errors import InputError, TensegraphError, begins_with, needs_extra, one_line, printable

Job = TypeVar("Job")
Made = TypeVar("Made")

ADDRESS = re.compile(r"tcp://[^\s/@]+:(\d{1,5})")
"""Address of a scheduler, with its port; other transports need certificates, or are of one process."""
LAST_PORT = 65535
ANSWERS_S = 10.0
"""Time within which a scheduler has to answer."""
DIED = "its process died while no other job was being done: is there enough memory?"


@dataclass(frozen=True, slots=True)
class Workers:
    """The processes that do the work.

    Raises:
        InputError: when both processes of this machine and a scheduler are asked for, or the scheduler has no address.
    """

    jobs: int = 1
    """Number of processes on this machine; with 1, the work is done in this process."""
    scheduler: str | None = None
    """Address of a dask scheduler, whose workers do the work instead."""

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.jobs != 1:
            raise InputError("--jobs and --scheduler: expected one of them, got both")
        address = ADDRESS.fullmatch(self.scheduler or "")
        if self.scheduler is not None and not (address and int(address[1]) <= LAST_PORT):
            raise InputError(f"--scheduler: expected tcp://HOST:PORT, got '{self.scheduler}'")

    def place(self, path: Path) -> Path:
        """Return a path as the workers find it, which may have started in another directory."""
        return path if self.jobs == 1 and self.scheduler is None else path.absolute()


@dataclass(frozen=True, slots=True, eq=False)
class _Outcome(Generic[Made]):
    """What became of one job."""

    name: str
    made: Made | None = None
    error: str = ""
    """Reason why nothing was made; empty if it was."""


class Many:
    """Does the same to many inputs. One that fails is a line at the end; the others are done."""

    def __init__(self, workers: Workers, terminal: Terminal) -> None:
        self._workers = workers
        self._terminal = terminal
        self._failed: dict[str, str] = {}
        self._count = 0

    def each(
        self, work: Callable[[Job, Terminal], Made], jobs: Mapping[str, Job], title: str
    ) -> Iterator[tuple[str, Made]]:
        """Yield the name of each job that is done, and what it made, as soon as it is.

        Args:
            work: function of a module, which workers import; of a job and the terminal for its progress.
            jobs: the jobs by name.
            title: of the bar, such as `trials`.

        Raises:
            TensegraphError: when the cluster cannot be used; or, for a single job in this process, its own.
        """
        self._count += len(jobs)
        if len(jobs) == 1 and self._workers.scheduler is None:
            for name, job in jobs.items():
                yield name, work(job, self._terminal)
            return
        with self._terminal.progress() as progress:
            bar = progress.add_task(title, total=len(jobs))
            for number, outcome in enumerate(self._outcomes(work, jobs), start=1):
                progress.update(bar, completed=number, description=f"{title}, {number} of {len(jobs)}")
                if outcome.error:
                    self._failed[outcome.name] = outcome.error
                    progress.console.print(f"{printable(outcome.name)}: failed", highlight=False)
                else:
                    yield outcome.name, outcome.made  # type: ignore[misc]

    def end(self) -> None:
        """Say which inputs failed.

        Raises:
            SystemExit: with 1 when one of them did.
        """
        if self._failed:
            for name, error in self._failed.items():
                self._terminal.error(error if begins_with(error, Path(name)) else f"{name}: {error}")
            self._terminal.error(f"{len(self._failed)} of {self._count} failed; the same command tries them again")
            raise SystemExit(1)

    def _outcomes(self, work: Callable[[Job, Terminal], Made], jobs: Mapping[str, Job]) -> Iterator[_Outcome[Made]]:
        """Yield what became of each job.

        When a process dies, nobody knows at which job. Those that had begun are done again after the others, one by
        one, so that a job at which processes die takes no other with it.
        """
        deaths = self._deaths()
        left, suspects = dict(jobs), dict[str, Job]()
        while left:
            begun: dict[str, Job] = {}
            try:
                for outcome in self._parallel(work, _moved(left, begun)):
                    del begun[outcome.name]
                    yield outcome
            except deaths:
                suspects |= begun
        for name, job in suspects.items():
            try:
                yield from self._parallel(work, [(name, job)])
            except deaths:
                yield _Outcome(name, error=DIED)

    def _parallel(
        self, work: Callable[[Job, Terminal], Made], jobs: Iterable[tuple[str, Job]]
    ) -> Iterator[_Outcome[Made]]:
        """Yield outcomes in the order in which they come; no more jobs are taken than there are workers."""
        here = self._terminal if self._workers == Workers() else None
        with self._backend() as count:
            parallel = Parallel(n_jobs=count, return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs")
            yield from parallel(delayed(_attempt)(work, name, job, code_hash(), here) for name, job in jobs)

    @contextmanager
    def _backend(self) -> Iterator[int]:
        """Choose where the work is done, and give the number of workers; -1 is all of the cluster's."""
        scheduler = self._workers.scheduler
        if scheduler is None:
            yield min(self._workers.jobs, self._count)
            return
        from distributed import Client

        connect: Any = Client  # the library has no types
        try:
            client = connect(scheduler, timeout=ANSWERS_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"--scheduler {scheduler}: no scheduler answers: {error}") from error
        with client, parallel_config(backend="dask", client=client):
            yield -1

    def _deaths(self) -> tuple[type[Exception], ...]:
        """Return the errors that say that a worker died."""
        if self._workers.scheduler is None:
            return (BrokenProcessPool,)
        with needs_extra("--scheduler", "cluster"):
            import distributed
        killed: Any = distributed.scheduler.KilledWorker  # the library has no types
        return (killed,)


def _moved(left: dict[str, Job], begun: dict[str, Job]) -> Iterator[tuple[str, Job]]:
    """Yield names and jobs, each of which is moved from those left to those begun."""
    while left:
        name = next(iter(left))
        begun[name] = left.pop(name)
        yield name, begun[name]


def _attempt(
    work: Callable[[Job, Terminal], Made], name: str, job: Job, code: str, terminal: Terminal | None
) -> _Outcome[Made]:
    """Do a job, and return what became of it, from any process.

    Args:
        work: the function that does it.
        name: of the job.
        job: the argument of the function.
        code: the hash of the package where the command was typed.
        terminal: for progress; None in another process.
    """
    try:
        if code != code_hash():
            raise InputError("the worker has another version of tensegraph: install there what is installed here")
        return _Outcome(name, work(job, terminal or Terminal(quiet=True)))
    except (TensegraphError, OSError) as error:
        return _Outcome(name, error=one_line(error))
    except Exception as error:
        return _Outcome(name, error=f"{type(error).__name__}: {error}: an error of the program; alone, it shows where")
