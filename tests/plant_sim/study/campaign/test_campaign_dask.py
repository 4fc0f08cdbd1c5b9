"""Campaigns on a Dask cluster: a real scheduler and two worker processes on the loopback interface."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.cli.main import main
from plant_sim.machine.parameters import load_machine
from plant_sim.study import engines
from plant_sim.study.campaign.file import Campaign
from plant_sim.study.campaign.run import CampaignPlan, execute
from plant_sim.study.campaign.version import code_version
from plant_sim.study.design_file import FactorDesign
from plant_sim.study.errors import StudyError
from tests.paths import ROOT
from tests.plant_sim.study.campaign.folders import LONG, LONG_RUNS, campaign, command, environment, keys, table, written
from tests.real_time import COMMAND_S


@contextmanager
def service(*arguments: str, ready: str, path: Path = ROOT) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run a Dask process during the block, which begins when it is ready; yield it and the address that it prints."""
    with subprocess.Popen(
        [sys.executable, "-m", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**environment(), "PYTHONPATH": str(path)},
        cwd=path,
    ) as process:
        try:
            assert process.stderr is not None
            found = (re.search(ready, line) for line in process.stderr)
            match = next((match for match in found if match is not None), None)
            assert match is not None, f"{arguments} ended"
            yield process, match[1]
        finally:
            process.kill()


@contextmanager
def scheduler() -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run a scheduler during the block; yield it and its address."""
    arguments = ("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    with service(*arguments, ready=r"Scheduler at:\s+(tcp://\S+)") as found:
        yield found


@contextmanager
def worker(address: str, folder: Path, path: Path = ROOT) -> Iterator[subprocess.Popen[str]]:
    """Run a worker with one thread during the block."""
    arguments = ("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
    place = ("--local-directory", str(folder / "dask"))
    with service(*arguments, *place, ready=r"Registered to:\s+(tcp://\S+)", path=path) as (process, _):
        yield process


@contextmanager
def started(file: Path, out: Path, address: str, *options: str) -> Iterator[subprocess.Popen[str]]:
    """Run the command in a process during the block."""
    arguments = command(
        file, out, *LONG, "--shard", "2", "--engine", "dask", "--scheduler", address, "--timeout", "60", *options
    )
    with subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment()
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_for(process: subprocess.Popen[str], runs: int) -> None:
    """Wait until a number of runs is complete."""
    assert process.stderr is not None
    printed: list[str] = []
    for line in process.stderr:
        printed.append(line)
        if re.match(r"\d+ of ", line) and int(line.split()[0]) >= runs:
            return
    pytest.fail(f"the campaign ended: {''.join(printed)}")


def finished(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Wait for the end of the command; return its exit code and its messages without the progress."""
    _, errors = process.communicate(timeout=COMMAND_S)
    return process.returncode, "\n".join(line for line in errors.splitlines() if not re.match(r"\d+ of ", line))


@pytest.mark.nightly
def test_a_killed_worker_does_not_change_the_results(tmp_path: Path) -> None:
    """One of two workers is killed during the campaign; the scheduler repeats its runs on the other one."""
    file, out = written(tmp_path), tmp_path / "out"
    with (
        scheduler() as (_, address),
        worker(address, tmp_path) as victim,
        worker(address, tmp_path),
        started(file, out, address) as process,
    ):
        wait_for(process, 4)
        victim.send_signal(signal.SIGKILL)
        assert finished(process) == (0, "")
    assert len(set(keys(out))) == LONG_RUNS
    assert campaign(file, tmp_path / "here", *LONG) == 0
    assert table(out) == table(tmp_path / "here")


@pytest.mark.nightly
def test_the_loss_of_all_workers_is_reported_in_one_line_and_the_campaign_can_be_continued(tmp_path: Path) -> None:
    """The first run of a worker takes several seconds, so a complete short campaign precedes."""
    file, out = written(tmp_path), tmp_path / "out"
    with scheduler() as (_, address), worker(address, tmp_path) as one:
        with started(file, out, address, "--trials", "1") as process:
            assert finished(process) == (0, "")
        with started(file, out, address, "--timeout", "8") as process:
            wait_for(process, 9)
            one.send_signal(signal.SIGKILL)
            code, errors = finished(process)
    stored = len(keys(out))
    assert 8 < stored < LONG_RUNS
    assert (code, errors) == (
        2,
        f"--scheduler {address}: no result for 8 s from 0 workers; start workers, or increase --timeout; {stored} of "
        f"{LONG_RUNS} runs are stored, the same command computes the others",
    )
    assert campaign(file, out, *LONG) == 0
    assert len(set(keys(out))) == len(keys(out)) == LONG_RUNS


@pytest.mark.nightly
def test_the_loss_of_the_scheduler_is_reported_in_one_line(tmp_path: Path) -> None:
    file, out = written(tmp_path), tmp_path / "out"
    with (
        scheduler() as (server, address),
        worker(address, tmp_path),
        started(file, out, address) as process,
    ):
        wait_for(process, 4)
        server.send_signal(signal.SIGKILL)
        code, errors = finished(process)
    assert code == 2
    assert errors == (
        f"--scheduler {address}: the connection was lost; start the scheduler and its workers again; {len(keys(out))} "
        f"of {LONG_RUNS} runs are stored, the same command computes the others"
    )


def changed(folder: Path) -> None:
    """Copy the sources, with one more line."""
    for package in ("controller", "plant_sim"):
        shutil.copytree(ROOT / package, folder / package)
    with (folder / "plant_sim/twin/trial.py").open("a") as source:
        source.write("# changed\n")


def without_campaigns(folder: Path) -> None:
    """Write a program that has no campaigns."""
    (folder / "plant_sim").mkdir(parents=True)
    (folder / "plant_sim/__init__.py").write_text('"""Another program."""\n')


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("other", "found"),
    [
        (changed, r"version 0\.\S+"),
        (without_campaigns, r"no version of the program \(.*No module named 'plant_sim.study'.*\)"),
    ],
)
def test_a_worker_with_another_version_is_rejected_before_the_first_run(
    other: Callable[[Path], None], found: str, tmp_path: Path
) -> None:
    file, out = written(tmp_path), tmp_path / "out"
    other(tmp_path / "other")
    with (
        scheduler() as (_, address),
        worker(address, tmp_path),
        worker(address, tmp_path, tmp_path / "other"),
        started(file, out, address) as process,
    ):
        code, errors = finished(process)
    assert code == 2
    complaint = (
        rf"--scheduler {address}: worker tcp://\S+ has {found} instead of {code_version()}; install the same one; "
    )
    assert re.match(complaint, errors), errors
    assert errors.count("\n") == 0
    assert keys(out) == []


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--scheduler", "tcp://127.0.0.1:1"), "--scheduler: has no effect without --engine dask; omit it, or add "),
        (("--engine", "dask"), "--scheduler is missing; write tcp://HOST:PORT, as the scheduler prints it"),
        (("--engine", "dask", "--scheduler", "host:1"), "--scheduler host:1: is not an address; write tcp://HOST:PORT"),
        (("--timeout", "9"), "--timeout: has no effect without --engine dask; omit it, or add --engine dask"),
        (("--engine", "dask", "--timeout", "0"), "--timeout 0: must be 1 to 86400"),
        (("--shard", "0"), "--shard 0: must be 1 or more"),
    ],
)
def test_an_invalid_option_is_reported_in_one_line(
    options: tuple[str, ...], complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", "campaign", str(written(tmp_path)), "--out", str(tmp_path / "out"), *options]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith(complaint)
    assert printed.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_scheduler_that_does_not_answer_is_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engines, "CONNECT_LIMIT_S", 0.5)
    address = "tcp://127.0.0.1:1"
    options = ("--out", str(tmp_path / "out"), *LONG, "--engine", "dask", "--scheduler", address)
    assert main(["study", "campaign", str(written(tmp_path)), *options]) == 2
    error = capsys.readouterr().err
    assert re.fullmatch(
        rf"--scheduler {address}: no scheduler \(.*\); start one with dask scheduler, or correct the address; 0 of "
        rf"{LONG_RUNS} runs are stored, the same command computes the others\n",
        error,
    )


def test_a_worker_that_joins_later_with_another_version_is_rejected() -> None:
    """The version is also checked before every run."""
    machine, io_map = load_machine(), load_io_map(DEFAULT_IO_MAP)
    design = FactorDesign("", (), (), np.zeros((1, 0)), {})
    plan = CampaignPlan(Campaign(Path("x.yaml"), design, ((),), 1, 1, 1), machine, io_map, "0.1.0-other")
    with pytest.raises(StudyError, match=rf"^worker on .*: has version {code_version()} instead of 0.1.0-other; "):
        execute(next(plan.runs()))
