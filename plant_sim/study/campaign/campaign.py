"""Execution of a campaign: the missing runs are computed and stored."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Final, Self

from filelock import FileLock, Timeout

from controller.common.modbus.io_map import IoMap
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.common.provenance.result_files import ResultFiles
from plant_sim.machine.parameters import Machine
from plant_sim.study.campaign.file import Campaign
from plant_sim.study.campaign.record import Record
from plant_sim.study.campaign.run import CampaignPlan, execute
from plant_sim.study.campaign.shards import Notice, ShardFolder, shard_schema
from plant_sim.study.campaign.version import code_version
from plant_sim.study.engines import Engine, Progress, WorkerLostError
from plant_sim.study.errors import StudyError

SHARD_RUNS: Final = 200
"""Default maximum number of runs in a result file."""
SHARD_S: Final = 30.0
"""Longest time for which the results of completed runs are in memory only, s."""


@dataclass(frozen=True, slots=True)
class CampaignOptions:
    """Options of a campaign that do not affect its results, and its machine.

    Attributes:
        folder: Folder of the campaign.
        machine: Base machine.
        io_map: I/O map.
        engine: Engine that executes the runs.
        shard_runs: Maximum number of runs in a result file.
        progress: Callback with the number of stored runs and their total, at the start and after every run.
        notice: Callback with a message of one line.
        provenance: Provenance that the files carry, with the effective seed.
    """

    folder: Path
    machine: Machine
    io_map: IoMap
    engine: Engine
    shard_runs: int
    progress: Progress
    notice: Notice
    provenance: Provenance


@dataclass(frozen=True, slots=True)
class CampaignResult:
    """Result of a campaign; the runs themselves are in the files.

    Attributes:
        files: Result files.
        version: Version of the program.
        runs: Number of runs.
        computed: Number of runs that were computed now.
        incomplete: Number of trials that did not complete.
    """

    files: int
    version: str
    runs: int
    computed: int
    incomplete: int


def run_campaign(campaign: Campaign, options: CampaignOptions) -> CampaignResult:
    """Compute the runs of a campaign that are not stored yet.

    Args:
        campaign: The campaign.
        options: Options.

    Raises:
        StudyError: The folder is in use or contains another campaign, a file cannot be written, or the engine failed.
            All completed runs are stored, unless a file cannot be written.
    """
    version = code_version()
    plan = CampaignPlan(campaign, options.machine, options.io_map, version)
    shards = ShardFolder(options.folder, version, shard_schema(campaign, version, options.provenance))
    with _locked(options.folder):
        stored = shards.scan(options.notice)
        found = sum(run.key in stored.keys for run in plan.runs())
        if found < len(stored.keys):
            raise StudyError(
                f"--out {options.folder}: contains {len(stored.keys) - found} runs that are not in {campaign.path} "
                "with this machine and I/O map; use another folder"
            )
        computed = _Computation(plan, shards, options, stored.keys, stored.incomplete)
        computed.run()
        files = ResultFiles(options.folder, options.provenance, StudyError)
        files.add(shards.files())
        files.finish()
        return CampaignResult(len(shards.files()), version, campaign.runs, campaign.runs - found, computed.incomplete)


class _Computation:
    """Computation of the missing runs.

    Attributes:
        incomplete: Number of trials that did not complete, including those stored before.
    """

    def __init__(
        self, plan: CampaignPlan, shards: ShardFolder, options: CampaignOptions, done: set[str], incomplete: int
    ) -> None:
        self.incomplete = incomplete
        self._plan = plan
        self._options = options
        self._done = done
        self._buffer = _Buffer(shards, options.shard_runs)

    def run(self) -> None:
        """Compute the missing runs; after the loss of a process, start again unless no run completed before.

        Raises:
            StudyError: The engine failed, or a file cannot be written.
        """
        total = self._plan.campaign.runs
        self._options.progress(len(self._done), total)
        while len(self._done) < total:
            before = len(self._done)
            try:
                self._run()
            except WorkerLostError as error:
                if len(self._done) == before:
                    raise self._interrupted(error) from None
                self._options.notice(f"{error}; its runs are computed again")
            except StudyError as error:
                raise self._interrupted(error) from None

    def _run(self) -> None:
        missing = (partial(execute, run) for run in self._plan.runs() if run.key not in self._done)
        with self._buffer, closing(self._options.engine.results(missing, ordered=False)) as records:
            for record in records:
                self._done.add(record["key"])
                self.incomplete += not record["completed"]
                self._buffer.add(record)
                self._options.progress(len(self._done), self._plan.campaign.runs)

    def _interrupted(self, error: StudyError) -> StudyError:
        stored = len(self._done) - self._buffer.pending
        return StudyError(
            f"{error}; {stored} of {self._plan.campaign.runs} runs are stored, the same command computes the others"
        )


class _Buffer:
    """Completed runs that are not in a file yet; as a context manager, it writes them at the end."""

    def __init__(self, shards: ShardFolder, most: int) -> None:
        self._shards = shards
        self._most = most
        self._records: list[Record] = []
        self._since_s = perf_counter()

    def __enter__(self) -> Self:
        self._since_s = perf_counter()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._write()

    @property
    def pending(self) -> int:
        """Number of runs that are in no file."""
        return len(self._records)

    def add(self, record: Record) -> None:
        """Add a run; write a file if it is due."""
        self._records.append(record)
        if len(self._records) >= self._most or perf_counter() - self._since_s >= SHARD_S:
            self._write()

    def _write(self) -> None:
        if self._records:
            self._shards.write(self._records)
        self._records = []
        self._since_s = perf_counter()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Create the folder of a campaign if it does not exist, and lock it for this process.

    Raises:
        StudyError: The folder contains something else, is in use, or cannot be written.
    """
    try:
        if folder.exists() and not folder.is_dir():
            raise StudyError(f"--out {folder}: is not a folder; specify a new folder or that of the campaign")
        if folder.is_dir() and not (folder / "runs").is_dir() and any(folder.iterdir()):
            raise StudyError(f"--out {folder}: contains other files; specify a new folder or that of the campaign")
        (folder / "runs").mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / "campaign.lock", timeout=0)
        lock.acquire()
    except Timeout:
        raise StudyError(f"--out {folder}: in use by another process; wait for it, or use another folder") from None
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise StudyError(f"--out {folder}: cannot be written ({reason}); specify another folder") from None
    try:
        yield
    finally:
        lock.release()
