"""Engines that run jobs in parallel through joblib: processes of this computer, or the workers of a Dask cluster."""

from __future__ import annotations

import importlib
import logging
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Any, Final, Protocol, TypeVar

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

from controller.common.output_streams import prepare_output_streams
from controller.common.stop_request import interrupts_blocked
from controller.common.supervision.threads import supervised
from plant_sim.study.errors import StudyError

Result = TypeVar("Result")
Progress = Callable[[int, int], None]
"""Callback with the number of completed trials and their total."""

CONNECT_LIMIT_S: Final = 10.0
"""Time limit for the connection to a scheduler, s."""
_MANAGER: Final = "ExecutorManagerThread"
"""Name of the thread of joblib that watches the processes."""
_ENDED_WITHIN_S: Final = 1.0
"""Time within which an interrupted command has ended, s (assumed)."""
_ORPHAN_S = 1.0
_DISPATCHED = 1_000
"""Maximum number of jobs at the scheduler: enough for workers that join after the start."""


class WorkerLostError(StudyError):
    """Process that was killed while it ran a job."""


class Engine(Protocol):
    """Way to run jobs in parallel."""

    def results(self, jobs: Iterable[Callable[[], Result]], *, ordered: bool) -> Generator[Result, None, None]:
        """Yield the results of jobs as soon as they are available; close the generator to cancel the remaining jobs.

        Args:
            jobs: The jobs; they must be picklable and hashable. They are taken from the iterable when they
                are dispatched.
            ordered: True to yield the results in the order of the jobs.

        Raises:
            StudyError: The engine cannot run the jobs.
        """


@dataclass(frozen=True, slots=True)
class ProcessEngine:
    """Processes of this computer.

    Attributes:
        workers: Number of processes; 1 = this process, None = one per core.
    """

    workers: int | None = None

    def __post_init__(self) -> None:
        """Check the number of processes."""
        if self.workers is not None and self.workers < 1:
            raise StudyError(f"--workers {self.workers}: must be 1 or more; omit it for one per core")

    def results(self, jobs: Iterable[Callable[[], Result]], *, ordered: bool) -> Generator[Result, None, None]:
        """Yield the results of jobs; see `Engine.results`.

        Raises:
            WorkerLostError: A process was killed.
        """
        with _loss_reported():
            yield from self._start(jobs, ordered=ordered)

    @contextmanager
    def prepared(self, prepare: Callable[[], object]) -> Iterator[None]:
        """Start the processes and let them execute a function while this process executes the body of the context.

        Args:
            prepare: The function; it must be picklable.

        Raises:
            WorkerLostError: A process was killed.
        """
        if self.workers == 1:
            yield
            return
        results = self._start([prepare] * (self.workers or joblib.cpu_count()), ordered=False)
        try:
            yield
        finally:
            with _loss_reported():
                deque(results, maxlen=0)

    def _start(self, jobs: Iterable[Callable[[], Result]], *, ordered: bool) -> Generator[Result, None, None]:
        """Start the jobs; return the generator of their results."""
        pool: dict[str, Any] = (
            {}
            if self.workers == 1
            else {"backend": "loky", "initializer": _prepare_process, "initargs": (os.getpid(),)}
        )
        threading.excepthook = _report_unless_ending
        if pool:  # up to Python 3.11, the start of this process unblocks interrupts, and the workers would receive them
            resource_tracker.ensure_running()
        with interrupts_blocked():
            return _parallel(jobs, ordered=ordered, n_jobs=-1 if self.workers is None else self.workers, **pool)


@dataclass(frozen=True, slots=True)
class DaskEngine:
    """Workers of a Dask cluster.

    Attributes:
        scheduler: Address of the scheduler, such as ``tcp://192.168.3.20:8786``.
        timeout_s: Longest wait for workers or for the next result, s.
        version: Function that returns the version of the program; every worker must have that of this process.

    Raises:
        ModuleNotFoundError: Dask is not installed.
    """

    scheduler: str
    timeout_s: float
    version: Callable[[], str]

    def __post_init__(self) -> None:
        """Check that Dask is installed."""
        importlib.import_module("distributed")

    def results(self, jobs: Iterable[Callable[[], Result]], *, ordered: bool) -> Generator[Result, None, None]:
        """Yield the results of jobs; see `Engine.results`. The scheduler repeats the jobs of a lost worker.

        Raises:
            StudyError: The scheduler is not available, a worker has another version, or there is no result within the
                time limit.
        """
        with closing(self._client()) as client:
            self._check_versions(client)
            try:
                yield from _parallel(
                    jobs,
                    ordered=ordered,
                    backend=_dask_backend(client, self.timeout_s),
                    timeout=self.timeout_s,
                    pre_dispatch=_DISPATCHED,
                )
            except (TimeoutError, multiprocessing.TimeoutError):
                raise self._error(
                    f"no result for {self.timeout_s:g} s from {len(client.ncores())} workers; start workers, or "
                    "increase --timeout"
                ) from None
            except CancelledError:
                raise self._error("the connection was lost; start the scheduler and its workers again") from None

    def _client(self) -> Any:
        """Return a client of the scheduler that prints no log messages."""
        from distributed import Client  # noqa: PLC0415 - an optional dependency

        # the event loop of the client reports a lost connection as well, in addition to the error of this engine
        for name in ("distributed", "tornado.application", *logging.getLogger("distributed").manager.loggerDict):
            if name.partition(".")[0] in {"distributed", "tornado"}:
                logging.getLogger(name).disabled = True
        connect: Any = Client  # without type annotations
        try:
            return connect(self.scheduler, timeout=CONNECT_LIMIT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            remedy = "start one with dask scheduler, or correct the address"
            raise self._error(f"no scheduler ({str(error).splitlines()[0]}); {remedy}") from None

    def _check_versions(self, client: Any) -> None:
        expected = self.version()
        found: dict[str, object] = client.run(self.version, on_error="return")
        for worker, version in found.items():
            if version != expected:
                text = f"version {version}" if isinstance(version, str) else f"no version of the program ({version})"
                raise self._error(f"worker {worker} has {text} instead of {expected}; install the same one")

    def _error(self, complaint: str) -> StudyError:
        return StudyError(f"--scheduler {self.scheduler}: {complaint}")


def _dask_backend(client: Any, timeout_s: float) -> Any:
    """Return joblib's backend of a Dask cluster.

    joblib executes all jobs in this process if a backend has a single worker at the start, even if more workers join
    later. The backend therefore reports at least two.
    """
    from joblib._dask import DaskDistributedBackend  # noqa: PLC0415 - imports Dask

    class Backend(DaskDistributedBackend):  # type: ignore[misc]
        def effective_n_jobs(self, n_jobs: int) -> int:
            return max(2, int(super().effective_n_jobs(n_jobs)))

    return Backend(client=client, wait_for_workers_timeout=timeout_s)


def _parallel(jobs: Iterable[Callable[[], Result]], *, ordered: bool, **options: Any) -> Generator[Result, None, None]:
    """Start the jobs with joblib and return its generator of results."""
    parallel = joblib.Parallel(return_as="generator" if ordered else "generator_unordered", **options)
    results: Generator[Result, None, None] = parallel(joblib.delayed(job)() for job in jobs)
    return results


def _report_unless_ending(error: threading.ExceptHookArgs) -> None:
    """Report the exception of a thread; that of joblib's manager only if this process still exists a second later.

    After Ctrl-C, the manager may find its processes ended while they start.
    """
    if error.thread is None or not error.thread.name.startswith(_MANAGER):
        threading.__excepthook__(error)
        return
    supervised("late report", lambda: _report_later(error)).start()


def _report_later(error: threading.ExceptHookArgs) -> None:
    threading.Event().wait(_ENDED_WITHIN_S)
    threading.__excepthook__(error)


@contextmanager
def _loss_reported() -> Iterator[None]:
    """Report the loss of a process as a `WorkerLostError`."""
    try:
        yield
    except TerminatedWorkerError:
        raise WorkerLostError(
            "--workers: a process was killed, possibly for lack of memory; use a smaller number"
        ) from None


def _prepare_process(parent: int) -> None:
    """Prepare the output streams of a process; let it ignore Ctrl-C, and end when its parent has been killed."""
    prepare_output_streams()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    supervised("parent of a worker", lambda: _end_after(parent)).start()


def _end_after(parent: int) -> None:
    """End this process within `_ORPHAN_S` after its parent; otherwise an idle process would remain for minutes."""
    wait = threading.Event().wait
    while os.getppid() == parent:
        wait(_ORPHAN_S)
    os._exit(1)


def spread(
    jobs: Sequence[Callable[[], Result]], workers: int | None = None, progress: Progress | None = None
) -> list[Result]:
    """Run jobs in parallel processes.

    Args:
        jobs: The jobs; they must be picklable.
        workers: Number of processes; 1 = this process, None = one per core.
        progress: Callback after every completed job.

    Returns:
        Results in the order of the jobs.

    Raises:
        StudyError: The number of processes is invalid, or a process was killed.
    """
    engine = ProcessEngine(workers)
    if len(jobs) <= 1:
        engine = ProcessEngine(1)
    elif workers is not None:
        engine = ProcessEngine(min(workers, len(jobs)))
    collected: list[Result] = []
    with closing(engine.results(jobs, ordered=True)) as results:
        for result in results:
            collected.append(result)
            if progress is not None:
                progress(len(collected), len(jobs))
    return collected
